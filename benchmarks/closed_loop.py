"""Policies from four kinds of simulator, scored in a world that none of them has seen: the paper's Tables 3 and 4 in kind.

python -m benchmarks closed_loop --out DIR [--task NAME ...] [--kind NAME ...] [--seeds 3]
                                 [--demos 50] [--steps N] [--episodes 50] [--cycles 1] [--starts 50]
                                 [--jobs 1] [--plot FILE.png]

The world is `make_stand_in`: MuJoCo, a robot with friction, weak and uneven drives and a delay that the nominal model has not,
a path-traced camera. plain: demonstrations of the nominal simulator; calibrated: of a model fitted to ten logs of the
robot; generated: the same, with VisAligner's generated pictures; preferred: generated, then cycles of preferences with generated pictures.
Beside them pictures_only, which is plain seen through VisAligner: what calibration adds where the pictures are right.
Seeds are those of training; the demonstrations of a task and kind are the same for all of them.
Everything is kept in DIR: an interrupted run goes on where it was, and two processes may share it by --task.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.act_runs import SIZE, keep_settings, play_each, played, train_act
from benchmarks.common import clopper_pearson

TASKS = ("GrabPaperCup", "PutPenInCup", "PutRemoteInBox", "PutCupOnMat")
KINDS = ("plain", "calibrated", "generated", "preferred", "pictures_only")
STEPS = (("plain", "calibrated"), ("calibrated", "generated"), ("generated", "preferred"), ("plain", "generated"),
         ("plain", "pictures_only"), ("pictures_only", "generated"))  # fmt: skip
NOMINAL, SEEN = ("plain", "pictures_only"), ("pictures_only", "generated")
FIRST_SEED = 500_000  # of the world

Found = Mapping[tuple[str, str, int], Sequence[Mapping[str, Any]]]  # by task, kind and seed, a row for each episode


def hidden(friction: float = 0.8, uneven: float = 0.5, delay: float = 0.03) -> dict[str, dict[str, Any]]:
    """What the robot has and the nominal model has not, by default the robot of this benchmark.

    friction: N m; uneven: drives have 1 - uneven to 1 + uneven times their torque; delay: s.
    """
    arm = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0] * 2)  # not the grippers, whose torque is N m per stroke
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, len(arm)) * arm
    return {
        "coulomb_friction": {"torque": friction * arm},
        "torque_constant": {"gain": 1.0 + uneven * drawn},
        "command_delay": {"seconds": delay},
    }


def calibrated(folder: Path) -> Path:
    """A model fitted to logs of the robot, written once; the effects are named, as `diagnose` names them, not their sizes."""
    from embodiedreamer_gym import calibrate
    from embodiedreamer_gym.standin.bench.robot import load_nominal, logs

    path = folder / "calibrated.json"
    if not path.is_file():
        model = load_nominal()
        for effect in hidden():
            model = model.with_effect(effect)
        found = calibrate(model, logs(hidden()))
        found.model.save(path)
        print(f"calibrated: {1e3 * found.error:.2f} mrad of free run", flush=True)
    return path


def episodes(a: argparse.Namespace, task: str, kind: str) -> Path:
    """Folder of demonstrations of a kind."""
    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
    from embodiedreamer_gym.pipelines.regenerate import regenerate

    robot = "aloha" if kind in NOMINAL else str(calibrated(a.out))
    folder = a.out / f"demos_{task}_{'plain' if kind in NOMINAL else 'calibrated'}"
    record_demonstrations(Demonstrations(task, size=SIZE, robot=robot), a.demos, folder)
    if kind not in SEEN:
        return folder
    seen = a.out / f"demos_{task}_{kind}"
    made = regenerate(folder, seen, jobs=a.jobs)
    if made.failed:
        print(f"{task}: the replay of {len(made.failed)} episodes failed", flush=True)
    return seen


def trained(a: argparse.Namespace, task: str, kind: str, seed: int) -> Path:
    """Folder of a policy."""
    from embodiedreamer_gym.recordings.episodes import open_episodes

    folder = a.out / f"policy_{task}_{kind}_{seed}"
    if (folder / "done").is_file():
        return folder
    if kind == "preferred":
        return preferred(a, task, seed, folder)

    def told(count: int, of: int, text: str) -> None:
        if count % 500 == 0:
            print(f"{task} {kind} {seed}: step {count} of {of}, {text}", flush=True)

    train_act(open_episodes(episodes(a, task, kind)), folder, {"steps": a.steps, "seed": seed}, told)
    (folder / "done").touch()
    return folder


def preferred(a: argparse.Namespace, task: str, seed: int, folder: Path) -> Path:
    """The policy of generated pictures after cycles of preferences in the calibrated simulator with generated pictures."""
    from embodiedreamer_gym.cli.command import main as embodiedreamer

    start, study = trained(a, task, "generated", seed), a.out / f"study_{task}_{seed}"
    failed = embodiedreamer([
        "policy", "prefer", "--policy", str(start), "--task", f"{task}-v0", "--out", str(study), "--vis-aligner",
        "--robot", str(calibrated(a.out)), "--cycles", str(a.cycles), "--starts", str(a.starts),
        "--evaluations", "1", "--seed", str(seed), "--quiet",
        "--jobs", str(a.jobs),
    ])  # fmt: skip
    if failed:
        raise SystemExit(failed)
    (study / "policy").rename(folder)
    (folder / "done").touch()
    return folder


def judged(a: argparse.Namespace, task: str, kind: str, seed: int) -> list[dict[str, Any]]:
    """One row for each episode in the world; those of an interrupted run are kept."""
    from embodiedreamer_gym.policies import load_policy
    from embodiedreamer_gym.standin.bench import make_stand_in

    path = a.out / f"world_{task}_{kind}_{seed}.json"
    policy, env = load_policy(str(trained(a, task, kind, seed))), make_stand_in(task, hidden(), size=SIZE)
    try:
        return play_each(path, a.episodes, lambda n: played(policy, env, FIRST_SEED + n), f"{task} {kind} {seed}")
    finally:
        env.close()


def report(found: Found, kinds: Sequence[str]) -> str:
    """Success of each task and kind with its interval, of each seed, and how many were picked up; what each step adds.

    Gains are ± their standard error over tasks and seeds.
    """
    tasks = list(dict.fromkeys(task for task, _, _ in found))
    seeds = sorted({seed for _, _, seed in found})
    lines = ["| | " + " | ".join(kinds) + " |", "|---" * (len(kinds) + 1) + "|"]
    for task in tasks:
        cells = []
        for kind in kinds:
            rows = [row for seed in seeds for row in found[task, kind, seed]]
            each = [sum(row["success"] for row in found[task, kind, seed]) for seed in seeds]
            low, high = clopper_pearson(sum(each), len(rows))
            cells.append(f"{sum(each) / len(rows):.1%} ({low:.1%} .. {high:.1%}); {' '.join(map(str, each))}; "
                         f"{sum(row['grasped'] for row in rows)} of {len(rows)} picked up")  # fmt: skip
        lines.append(f"| {task} | " + " | ".join(cells) + " |")
    for before, after in STEPS:
        if not {before, after} <= set(kinds):
            continue
        gains = np.array([
            np.mean([b["success"] - a["success"] for a, b in zip(found[t, before, s], found[t, after, s], strict=True)])
            for t in tasks for s in seeds
        ])  # fmt: skip
        error = gains.std(ddof=1) / np.sqrt(len(gains)) if len(gains) > 1 else float("nan")
        lines.append(f"{after} over {before}: {100 * gains.mean():+.1f} ± {100 * error:.1f} points")
    return "\n".join(lines)


def draw(found: Found, kinds: Sequence[str], path: Path) -> None:
    """Success by task and kind, as bars with their intervals."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    tasks = list(dict.fromkeys(task for task, _, _ in found))
    figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    for place, kind in enumerate(kinds):
        ends = [[row["success"] for (t, k, _), rows in found.items() if (t, k) == (task, kind) for row in rows]
                for task in tasks]  # fmt: skip
        share = 100 * np.array([np.mean(one) for one in ends])
        bounds = 100 * np.array([clopper_pearson(sum(one), len(one)) for one in ends]).T
        where = np.arange(len(tasks)) + (place - 0.5 * (len(kinds) - 1)) * 0.8 / len(kinds)
        axes.bar(where, share, 0.75 / len(kinds), yerr=np.abs(bounds - share), capsize=2, label=kind)
    axes.set(xticks=range(len(tasks)), xticklabels=tasks, ylim=(0, 100), ylabel="success in the stand-in world, %")
    axes.legend(frameon=False, ncols=len(kinds), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=150)
    plt.close(figure)


def main() -> None:
    """Train and judge what is missing, then print the tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--task", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    for name, value in (
        ("seeds", 3),
        ("demos", 50),
        ("steps", None),
        ("episodes", 50),
        ("cycles", 1),
        ("starts", 50),
        ("jobs", 1),
    ):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--plot", type=Path)
    a = parser.parse_args()
    if a.plot and not a.plot.absolute().parent.is_dir():  # said before hours of work, not after them
        parser.error(f"folder {a.plot.absolute().parent} does not exist; make it first.")
    import torch

    import embodiedreamer_gym  # noqa: F401  its environments are registered

    torch.set_num_threads(1)
    keep_settings(a.out, demos=a.demos, steps=a.steps, cycles=a.cycles, starts=a.starts)
    kinds = [kind for kind in KINDS if kind in a.kind]
    found = {(t, k, s): judged(a, t, k, s) for s in range(a.seeds) for t in a.task for k in kinds}
    print(report(found, kinds))
    if a.plot:
        draw(found, kinds, a.plot)


if __name__ == "__main__":
    main()
