"""Key poses in the stand-in world: effect of perception, and of commands through the calibrated model.

python -m benchmarks key_poses --out DIR [--task NAME ...] [--world nominal stand-in] [--look true generated simulator]
                               [--mode nominal off trim feed_forward both] [--demos 50] [--scenes 360] [--episodes 40]
                               [--first-seed 830000]

Key poses are learnt from recorded demonstrations, with the object poses stored in the files. `nominal` is the simulator
of the demonstrations. `stand-in` is the world of `closed_loop`. Its modes are those of `CalibratedTracking`, with the
model that `closed_loop` fits to logs of the robot; the mode nominal is `both` with the model without effects.
--look selects the object detection: true uses the true poses; generated uses the detector that `policy train --scenes`
trains on generated first frames of other scenes; simulator is the same with the plain simulator's pictures. The last
two get one path-traced picture of each scene (stand-in only, with Blender's bpy), and a table gives their errors.
Everything is kept in DIR.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.act_runs import one_thread, play_each
from benchmarks.closed_loop import TASKS, calibrated, hidden
from benchmarks.common import clopper_pearson, save

WORLDS, LOOKS = ("nominal", "stand-in"), ("true", "generated", "simulator")
MODES = ("nominal", "off", "trim", "feed_forward", "both")
CHUNK = 300


def demonstrations(a: argparse.Namespace, task: str) -> Path:
    """Folder of a task's demonstrations, whose pictures are not used."""
    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations

    record_demonstrations(Demonstrations(task, size=(16, 12)), a.demos, a.out / task)
    return a.out / task


def trained(a: argparse.Namespace, task: str, look: str) -> Any:
    """The policy with the detector of a look, trained once."""
    from embodiedreamer_gym.pipelines.key_pose_scenes import train_on_scenes
    from embodiedreamer_gym.policies import load_policy

    folder, bank = a.out / f"policy_{task}_{look}", "lab" if look == "generated" else None
    if not (folder / "config.json").is_file():
        train_on_scenes(demonstrations(a, task), folder, a.scenes, bank)
    return load_policy(str(folder))


def skill_of(a: argparse.Namespace, task: str) -> Any:
    """Key poses of a task's demonstrations."""
    from embodiedreamer_gym.pipelines.key_pose_scenes import shown_in
    from embodiedreamer_gym.policies.key_pose import learn
    from embodiedreamer_gym.policies.key_pose.arms import Arms
    from embodiedreamer_gym.robot import RobotModel

    return learn(shown_in(demonstrations(a, task))[1], Arms(RobotModel.load("aloha")))


def traced(a: argparse.Namespace, task: str) -> tuple[np.ndarray, np.ndarray]:
    """Path-traced first pictures (N, H, W, 3) in the stand-in world, and true poses (N, things, 3), kept in a file."""
    from embodiedreamer_gym.pipelines.key_pose_scenes import lying
    from embodiedreamer_gym.standin.bench import make_stand_in

    path = a.out / f"traced_{task}_{a.first_seed}.npz"
    if path.is_file() and len(np.load(path)["pictures"]) >= a.episodes:
        file = np.load(path)
        return file["pictures"][: a.episodes], file["scenes"][: a.episodes]
    env = make_stand_in(task, hidden(), chunk=CHUNK)
    aloha, pictures, scenes = env.unwrapped, [], []
    for number in range(a.episodes):
        pictures.append(env.reset(seed=a.first_seed + number)[0]["pixels"])
        scenes.append([lying(aloha.object_pose(prop.name)) for prop in aloha.task.props])  # pyright: ignore
    env.close()
    np.savez(path, pictures=np.array(pictures), scenes=np.array(scenes))
    return np.array(pictures), np.array(scenes)


def errors(a: argparse.Namespace, task: str, look: str) -> str:
    """Lines of the perception table: median, 90th percentile and largest error of each object."""
    from embodiedreamer_gym.policies.key_pose.frames import folded
    from embodiedreamer_gym.policies.key_pose.silhouette import is_round

    looker, (pictures, scenes), lines = trained(a, task, look).look, traced(a, task), []
    found = [looker({"head": picture}) for picture in pictures]
    for number, name in enumerate(looker.things):
        pairs = [(one[name], true[number]) for one, true in zip(found, scenes, strict=True) if one is not None]
        away = [1e3 * np.hypot(x[0] - y[0], x[1] - y[1]) for x, y in pairs]
        turned = [abs(np.degrees(folded(x[2] - y[2]))) for x, y in pairs]
        cells = [" / ".join(f"{np.percentile(v, q):.1f}" for q in (50, 90, 100)) if v else "-" for v in (away, turned)]
        cells[1] = "-" if is_round(looker.shapes[name]) else cells[1]
        lines.append(f"| {task} | {look} | {name} | {cells[0]} | {cells[1]} | {len(found) - len(pairs)} |")
    return "\n".join(lines)


def wrapper(a: argparse.Namespace, mode: str, world: str) -> Callable[[Any], Any]:
    """Function that wraps an environment in `CalibratedTracking`."""
    from embodiedreamer_gym.wrappers import CalibratedTracking

    model = "aloha" if world == "nominal" or mode in ("nominal", "off", "trim") else str(calibrated(a.out))
    return lambda env: CalibratedTracking(env, model, "both" if mode == "nominal" else mode)


def judged(a: argparse.Namespace, task: str, world: str, look: str, mode: str) -> dict[str, Any]:
    """A row of the table."""
    import gymnasium as gym

    from embodiedreamer_gym.envs import task_id
    from embodiedreamer_gym.pipelines.key_pose_scenes import lying
    from embodiedreamer_gym.policies.evaluation import play
    from embodiedreamer_gym.policies.key_pose import KeyPosePolicy
    from embodiedreamer_gym.robot import RobotModel
    from embodiedreamer_gym.standin.bench import make_stand_in
    from embodiedreamer_gym.wrappers import ActionChunk

    wrap = wrapper(a, mode, world)
    if world == "nominal":
        env = ActionChunk(wrap(gym.make(task_id(task), image_size=(16, 12), disable_env_checker=True)), CHUNK)
    else:
        env = make_stand_in(task, hidden(), chunk=CHUNK, pictures="none", wrap=wrap)
    aloha: Any = env.unwrapped
    if look == "true":
        policy, pictures = KeyPosePolicy(skill_of(a, task), RobotModel.load("aloha"), lambda _: {}, 30.0), []
    else:
        policy, pictures = trained(a, task, look), traced(a, task)[0]
    looker = policy.look

    def one(number: int) -> dict[str, Any]:
        if look == "true":
            policy.look = lambda _: {prop.name: lying(aloha.object_pose(prop.name)) for prop in aloha.task.props}
        else:
            policy.look = lambda _: looker({"head": pictures[number]})
        return asdict(play(policy, env, a.first_seed + number, CHUNK))

    path = a.out / f"played_{task}_{world}_{look}_{mode}_{a.first_seed}.json"
    rows = play_each(path, a.episodes, one, f"{task} {world} {look} {mode}")
    env.close()
    hits = sum(row["success"] for row in rows)
    low, high = clopper_pearson(hits, len(rows))
    return {"task": task, "world": world, "look": look, "tracking": mode, "picked_up": sum(row["grasped"] for row in rows),
            "hits": hits, "of": len(rows), "low": low, "high": high}  # fmt: skip


def line(row: dict[str, Any]) -> str:
    """A row as a line of the table."""
    share = "{hits} of {of}, {:.1%} ({low:.1%} .. {high:.1%})".format(row["hits"] / row["of"], **row)
    return f"| {row['task']} | {row['world']} | {row['look']} | {row['tracking']} | {row['picked_up']} | {share} |"


def main() -> None:
    """Record what is missing, play and print the tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path, help="rows of the table as JSON")
    parser.add_argument("--task", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--world", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--look", nargs="+", choices=LOOKS, default=["true"])
    parser.add_argument(
        "--mode", nargs="+", choices=MODES, default=list(MODES), help="tracking modes in the stand-in world"
    )
    for name, value in (("demos", 50), ("scenes", 360), ("episodes", 40), ("first-seed", 830_000)):
        parser.add_argument(f"--{name}", type=int, default=value)
    a = parser.parse_args()
    one_thread()
    print("| task | world | look | tracking | picked up | success |\n" + "|---" * 6 + "|")
    rows: list[dict[str, Any]] = []
    seen: list[str] = []
    for task in a.task:
        for look in a.look:
            for world in a.world if look == "true" else ["stand-in"]:
                for mode in ["nominal"] if world == "nominal" else a.mode:
                    rows.append(judged(a, task, world, look, mode))
                    print(line(rows[-1]), flush=True)
                    save(rows, a.json)
            seen += [errors(a, task, look)] if look != "true" else []
    if seen:
        print("\n| task | look | object | mm (50 / 90 / 100 %) | degrees | scenes lost |\n" + "|---" * 6 + "|")
        print("\n".join(seen))


if __name__ == "__main__":
    main()
