"""Scripted experts: success of each task on unseen seeds, with the nominal and with another robot.

python -m benchmarks experts [--episodes 100] [--seed 100000] [--task NAME ...] [--engine bullet mujoco]
                            [--jobs 2] [--shard I/N] [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]

The other robot represents a calibrated one: each gain is 0.7 to 1.3 times the nominal gain, joints 1 to 3 have Coulomb
friction of 0.3 N m, each hand carries 0.1 kg, commands arrive 20 ms late. The expert knows its gains, not its effects.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from scipy.stats import binomtest

import embodiedreamer_gym  # noqa: F401  registers its environments
from benchmarks.cases import case_options, one_sentence, run_cases, save_results
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.io.cases import Cases
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


@lru_cache(maxsize=1)
def environment(task: str, robot: str, engine: str) -> gym.Env:
    """The environment of a group of consecutive cases (cached)."""
    with tempfile.TemporaryDirectory() as folder:
        file = "aloha" if robot == "nominal" else str(other_robot(folder))
        return gym.make(f"EmbodieDreamer/{task}-v0", obs_type="state", robot=file, engine=engine)


def play(case: Mapping[str, Any]) -> dict[str, Any]:
    """Play one episode to its end: results of its last step, and the step of its first success."""
    env = environment(case["task"], case["robot"], case["engine"])
    env.reset(seed=case["seed"])
    expert = ScriptedExpert(env)
    first, steps, over = None, 0, False
    info: dict[str, Any] = {}
    while not over:
        _, _, terminated, truncated, info = env.step(expert.act())
        over, steps = terminated or truncated, steps + 1
        first = steps if first is None and info["is_success"] else first
    return {"side": info["side"], "grasp": info["grasp_success"], "success": info["is_success"], "first": first}


def table(rows: list[dict[str, Any]]) -> str:
    """One line for each task, robot and engine."""
    lines = [f"{'task':<16}{'robot':<9}{'engine':<8}{'picked up':>10}{'success':>9}{'95 % interval':>16}{'median step':>13}{'last':>6}"]  # fmt: skip
    for group, some in itertools.groupby(rows, lambda row: (row["task"], row["robot"], row["engine"])):
        played = list(some)
        hits, of = sum(row["success"] for row in played), len(played)
        low, high = binomtest(hits, of).proportion_ci()  # Clopper-Pearson
        steps = [row["first"] for row in played if row["success"]]
        lines.append(f"{group[0]:<16}{group[1]:<9}{group[2]:<8}{sum(row['grasp'] for row in played):>6}/{of}{hits:>5}/{of}"
                     f"{f'{low:.1%} .. {high:.1%}':>16}{np.median(steps or [np.nan]):>13.0f}{max(steps, default=0):>6}"
                     + "".join(f"  failed: {row['seed']}" for row in played if not row["success"]))  # fmt: skip
    return "\n".join(lines)


def shown(row: dict[str, Any]) -> str:
    """A finished case as one line."""
    return f"{row['task']:<16}{row['robot']:<9}{row['engine']:<8}{row['seed']:>8} {'success' if row['success'] else 'failed'}"


def main() -> None:
    """Play the episodes that are missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=100_000)
    parser.add_argument("--task", nargs="*", default=list(TASKS))
    parser.add_argument("--engine", nargs="*", default=["bullet", "mujoco"], choices=["bullet", "mujoco"])
    case_options(parser)
    a = parser.parse_args()
    names, seeds = ("task", "robot", "engine", "seed"), range(a.seed, a.seed + a.episodes)
    each = itertools.product(a.task, ("nominal", "other"), a.engine, seeds)
    cases = Cases({"benchmark": "experts"}, [dict(zip(names, one, strict=True)) for one in each])
    from benchmarks.experts import play as work  # not from __main__: worker processes import it, with its cache

    with one_sentence():
        rows = run_cases(a, cases, work, a.out, a.rows, shown)
    print(table(rows))
    kept = [{key: row[key] for key in (*names, "side", "grasp", "success", "first")} for row in rows]
    save_results(a, cases, rows, list(seeds), {"rows": kept})


if __name__ == "__main__":
    main()
