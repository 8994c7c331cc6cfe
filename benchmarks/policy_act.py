"""ACT on a task's demonstrations: success on unseen seeds, with and without chunks, and training time.

python -m benchmarks policy_act --out DIR [--task PutCupOnMat] [--demos 50] [--episodes 200] [--steps N] [--batch B]
                                [--size 128x96] [--variant act unmirrored cloning ...] [--execute 100 25 ...] [--seed 0]

Everything is kept in DIR, and an interrupted run resumes. Variants: act, chunks of 100 from object poses, also trained
on each demonstration's mirror image; unmirrored, without mirror images; anywhere, training samples start at any step
with the same probability; keypoints, the transformer with key points, without the objects' masks; pictures, also
without key points; cloning, behaviour cloning without chunks (one action per query). The defaults of steps and batch
are those of `policy train`. One process, one thread.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym

import embodiedreamer_gym  # noqa: F401  registers its environments
from benchmarks.act_runs import SIZE, ProcessorTime, play_each, played, train_act
from benchmarks.common import clopper_pearson

VARIANTS: dict[str, dict[str, Any]] = {  # options of the network, and whether mirror images are used
    "act": {"chunk": 100, "mirror": True},
    "unmirrored": {"chunk": 100, "mirror": False},
    "anywhere": {"chunk": 100, "mirror": True, "chunk_start_share": 0.0},
    "keypoints": {"chunk": 100, "mirror": True, "eyes": False},
    "pictures": {"chunk": 100, "mirror": True, "eyes": False, "keypoints": 0},
    "cloning": {"chunk": 1, "mirror": True},
}
FIRST_SEED = 100_000


def demonstrations(a: argparse.Namespace) -> Path:
    """Episodes of the scripted expert, 128 x 96 of the head camera."""
    from embodiedreamer_gym.io.progress import Progress
    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations

    folder = a.out / f"demos_{a.task}_{a.demos}"  # training uses all episodes of a folder, so the name has their number
    record_demonstrations(Demonstrations(a.task), a.demos, folder, 1, Progress())
    return folder


def trained(a: argparse.Namespace, variant: str, data: Path) -> tuple[Any, float]:
    """The policy of a variant, and the processor time (s) of its training, without interruptions."""
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.policies.act import ActPolicy
    from embodiedreamer_gym.recordings.episodes import open_episodes

    folder = a.out / run_name(a, variant)
    clock = ProcessorTime(folder)
    if (folder / "done").is_file():
        return ActPolicy.load(folder), clock.before

    def told(count: int, of: int, text: str) -> None:
        if count % 250 == 0:
            print(f"{variant}: step {count}/{of}, {text}, {clock.save():.0f} s of processor time", flush=True)

    network = dict(VARIANTS[variant])
    training = {
        "steps": a.steps,
        "batch": a.batch,
        "seed": a.seed,
        "chunk_start_share": network.pop("chunk_start_share", None),
    }
    policy = train_act(open_episodes(data), folder, training, told, small=read_size(a.size), **network)
    seconds = clock.save()
    (folder / "done").touch()
    return policy, seconds


def run_name(a: argparse.Namespace, variant: str) -> str:
    """Base name of a variant's files."""
    return f"{a.task}_{variant}_{a.demos}_{a.steps or 'usual'}x{a.batch or 'usual'}_{a.size}_{a.seed}"


def judged(a: argparse.Namespace, variant: str, policy: Any, execute: int) -> list[dict[str, Any]]:
    """One row for each episode; rows of an interrupted run are reused."""
    path = a.out / f"{run_name(a, variant)}_execute{execute}.json"
    env = gym.make(f"EmbodieDreamer/{a.task}-v0", image_size=SIZE)
    rows = play_each(path, a.episodes, lambda n: played(policy, env, FIRST_SEED + n, execute),
                     f"{variant}, {execute} executed")  # fmt: skip
    env.close()
    return rows


def main() -> None:
    """Print one line for each variant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--task", default="PutCupOnMat")
    parser.add_argument("--variant", nargs="+", choices=VARIANTS, default=["act", "unmirrored", "cloning"])
    parser.add_argument("--execute", nargs="+", type=int, default=[100])
    parser.add_argument("--size", default="128x96")
    for name, value in (("demos", 50), ("episodes", 200), ("steps", None), ("batch", None), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    a = parser.parse_args()
    import torch

    torch.set_num_threads(1)
    a.out.mkdir(parents=True, exist_ok=True)
    data, lines = demonstrations(a), []
    for variant in a.variant:
        policy, seconds = trained(a, variant, data)
        for execute in sorted({min(n, policy.chunk) for n in a.execute}):
            rows = judged(a, variant, policy, execute)
            hits, grasps = sum(row["success"] for row in rows), sum(row["grasped"] for row in rows)
            low, high = clopper_pearson(hits, len(rows))
            lines.append(f"{variant:<10}{policy.chunk:>7}{execute:>9}{grasps:>7}/{len(rows)}{hits:>6}/{len(rows)}"
                         f"{f'{low:.1%} .. {high:.1%}':>18}{seconds:>10.0f} s")  # fmt: skip
    print(f"{a.task}, {a.demos} demonstrations, {a.steps or 'usual'} steps, pictures {a.size}")
    print(
        f"{'variant':<10}{'chunk':>7}{'executed':>9}{'picked up':>11}{'success':>10}{'95 % interval':>18}{'training':>12}"
    )
    print("\n".join(lines))


if __name__ == "__main__":
    main()
