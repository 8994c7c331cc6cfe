"""Rollouts of a policy in the dreamed world: seconds for 100 of PutCupOnMat, in as many processes as there are cores.

python -m benchmarks dreamed_rollouts [--policy DIR] [--rollouts 100] [--jobs 2] [--execute 100] [--every 1]

Whole episodes of 300 steps, head camera 128 x 96, every n-th frame dreamed by the shipped weights. Without a policy, an ACT
network that has learnt nothing plays: what it costs is the same. Also printed, of one rollout: the same without dreaming.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from benchmarks.common import pin_threads

TASK, SIZE, FIRST = "PutCupOnMat", (128, 96), 400_000


def policy_of(folder: Path | None) -> Any:
    """The policy in a folder, or one that has learnt nothing."""
    from embodiedreamer_gym.policies import load_policy
    from embodiedreamer_gym.policies.act import Act, ActConfig, ActPolicy

    if folder is not None:
        return load_policy(str(folder))
    return ActPolicy(Act(ActConfig(14, 14, ("head",), (96, 72), source_size=SIZE)))


def play(folder: Path | None, seeds: range, execute: int, aligner: bool, out: Path, every: int = 1) -> float:
    """Record rollouts into a folder; seconds on the clock, without starting."""
    pin_threads()
    import torch

    from embodiedreamer_gym.pipelines.policy_env import policy_world
    from embodiedreamer_gym.wrappers.preference_rollout import PreferenceRolloutWrapper

    torch.set_num_threads(1)
    policy = policy_of(folder)
    env = policy_world(policy, TASK, execute=execute, vis_aligner="lean" if aligner else None, every=every)
    begun = time.perf_counter()
    PreferenceRolloutWrapper(env, tries=1).record(policy, seeds, out)
    env.close()
    return time.perf_counter() - begun


def main() -> None:
    """Print seconds on the clock for all, and for one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--policy", type=Path)
    for name, value in (("rollouts", 100), ("jobs", 2), ("execute", 100), ("every", 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plain = play(a.policy, range(FIRST, FIRST + 3), a.execute, False, Path(folder) / "plain") / 3
        dreamed = play(a.policy, range(FIRST, FIRST + 3), a.execute, True, Path(folder) / "dreamed", a.every) / 3
        parts = [range(FIRST + k, FIRST + a.rollouts, a.jobs) for k in range(a.jobs)]
        begun = time.perf_counter()
        Parallel(n_jobs=a.jobs)(
            delayed(play)(a.policy, part, a.execute, True, Path(folder) / "all", a.every) for part in parts
        )
        whole = time.perf_counter() - begun
    print(f"one rollout of 300 steps: {plain:.2f} s in the plain simulator, {dreamed:.2f} s dreamed")
    print(f"{a.rollouts} dreamed rollouts in {a.jobs} processes: {whole:.0f} s, their start included")


if __name__ == "__main__":
    main()
