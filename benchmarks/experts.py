"""Scripted experts: how often each task succeeds on seeds not looked at, with the nominal and with another robot.

python -m benchmarks experts [--episodes 100] [--seed 100000] [--task NAME ...] [--engine bullet mujoco] [--out FILE.json]

The other robot stands for a calibrated one: each gain is 0.7 to 1.3 times the nominal one's, joints 1 to 3 have Coulomb
friction of 0.3 N m, each hand carries 0.1 kg, commands arrive 20 ms late. The expert knows its gains, not its effects.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from pathlib import Path

import gymnasium as gym
import numpy as np
from scipy.stats import binomtest

import embodiedreamer_gym  # noqa: F401  its environments are registered
from benchmarks.common import pin_threads, save
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.robot import RobotModel


def other_robot(folder: str | Path, seed: int = 0) -> Path:
    """Write a robot that differs from the nominal one as calibrations do; return its file."""
    model, rng = RobotModel.load("aloha"), np.random.default_rng(seed)
    gains = {group: getattr(model, group) * rng.uniform(0.7, 1.3, model.n) for group in ("stiffness", "damping")}
    for effect in ("coulomb_friction", "payload", "command_delay"):
        model = model.with_effect(effect)
    model = model.with_(name=f"other{seed}", **gains).with_values({
        "coulomb_friction.torque": {joint: 0.3 for joint in model.joints if joint.endswith(("joint1", "joint2", "joint3"))},
        "payload.mass": dict.fromkeys(model.arms, 0.1),
        "command_delay.seconds": dict.fromkeys(model.joints, 0.02),
    })  # fmt: skip
    path = Path(folder) / f"other{seed}.json"
    model.save(path)
    return path


def play(env: gym.Env, seed: int) -> dict:
    """One episode to its end: what its last step says, and the step at which it first succeeded."""
    env.reset(seed=seed)
    expert = ScriptedExpert(env)
    first, steps, over = None, 0, False
    info: dict = {}
    while not over:
        _, _, terminated, truncated, info = env.step(expert.act())
        over, steps = terminated or truncated, steps + 1
        first = steps if first is None and info["is_success"] else first
    return {
        "seed": seed,
        "side": info["side"],
        "grasp": info["grasp_success"],
        "success": info["is_success"],
        "first": first,
    }


def main() -> None:
    """Print one line for each task and robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=100_000)
    parser.add_argument("--task", nargs="*", default=list(TASKS))
    parser.add_argument("--engine", nargs="*", default=["bullet", "mujoco"], choices=["bullet", "mujoco"])
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    pin_threads()
    rows = []
    print(
        f"{'task':<16}{'robot':<9}{'engine':<8}{'picked up':>10}{'success':>9}{'95 % interval':>16}{'median step':>13}{'last':>6}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for task in arguments.task:
            robots = (("nominal", "aloha"), ("other", str(other_robot(folder))))
            for (name, robot), engine in itertools.product(robots, arguments.engine):
                env = gym.make(f"EmbodieDreamer/{task}-v0", obs_type="state", robot=robot, engine=engine)
                played = [play(env, arguments.seed + k) for k in range(arguments.episodes)]
                env.close()
                rows += [{"task": task, "robot": name, "engine": engine, **row} for row in played]
                save(rows, arguments.out)
                hits, of = sum(row["success"] for row in played), len(played)
                low, high = binomtest(hits, of).proportion_ci()  # Clopper-Pearson
                steps = [row["first"] for row in played if row["success"]]
                print(f"{task:<16}{name:<9}{engine:<8}{sum(row['grasp'] for row in played):>6}/{of}{hits:>5}/{of}"
                      f"{f'{low:.1%} .. {high:.1%}':>16}{np.median(steps or [np.nan]):>13.0f}{max(steps, default=0):>6}"
                      + "".join(f"  failed: {row['seed']}" for row in played if not row["success"]), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
