"""Open-loop replay of the scripted expert's actions on the stand-in's bench: impact of the hidden effects.

python -m benchmarks standin_replay [--episodes 20] [--task NAME ...] [--calibrated FILE.json] [--out FILE.json]

The expert plays in `AlohaEnv`; its actions are then played in `make_stand_in` with the same seeds, without feedback.
--calibrated: a model of `closed_loop`'s robot, which that benchmark writes to its folder; the expert then also plays in
it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closed_loop import TASKS, hidden
from benchmarks.common import save

STEPS = 300


def robots() -> dict[str, dict[str, Any]]:
    """Name -> hidden effects of a robot; the robot of `closed_loop` is last."""
    return {
        "no effects, own errors (`seed_of_robot=0`)": {},
        "friction 0.3 N m, drives of 0.8 to 1.2 times their torque, 20 ms late": hidden(0.3, 0.2, 0.02),
        "friction 0.5 N m, drives of 0.6 to 1.4 times their torque, 20 ms late": hidden(0.5, 0.4, 0.02),
        "that of `closed_loop`: friction 0.8 N m, drives of 0.5 to 1.5 times their torque, 30 ms late": hidden(),
    }


def actions_of_expert(env: Any, seed: int) -> tuple[np.ndarray, bool]:
    """The expert's actions (STEPS, 14) in an episode, and whether it succeeds."""
    from embodiedreamer_gym.envs.experts import ScriptedExpert

    env.reset(seed=seed)
    expert, actions, info = ScriptedExpert(env), [], {}
    for _ in range(STEPS):
        actions.append(expert.act())
        info = env.step(actions[-1])[4]
    return np.array(actions), bool(info["is_success"])


def replayed(world: Any, seed: int, actions: np.ndarray) -> bool:
    """Whether actions succeed in the stand-in world."""
    world.reset(seed=seed)
    info: dict[str, Any] = {}
    for start in range(0, STEPS, world.k):
        info = world.step(actions[start : start + world.k])[4]
    return bool(info["is_success"])


def main() -> None:
    """Print successes by robot and task."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--task", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--calibrated", type=Path)
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    from embodiedreamer_gym.envs.aloha import AlohaEnv
    from embodiedreamer_gym.envs.robots import load_robot
    from embodiedreamer_gym.errors import EmbodieDreamerError
    from embodiedreamer_gym.standin.bench import make_stand_in

    try:
        load_robot(a.calibrated or "aloha")
    except EmbodieDreamerError as error:
        parser.error(str(error))
    found: dict[str, dict[str, list[bool]]] = {}
    models = {"": "aloha"} | ({" of the calibrated model": str(a.calibrated)} if a.calibrated else {})
    for task in a.task:
        worlds = {name: make_stand_in(task, effects, pictures="none") for name, effects in robots().items()}
        for said, model in models.items():
            plain = AlohaEnv(task, model, obs_type="state")
            here = {name: worlds[name] for name in ([*worlds] if not said else [*worlds][-1:])}
            for seed in range(a.episodes):
                actions, success = actions_of_expert(plain, seed)
                ends = {f"in the `AlohaEnv`{said} itself": success}
                ends |= {
                    name + (f"; the expert's actions{said}" if said else ""): replayed(world, seed, actions)
                    for name, world in here.items()
                }
                for name, end in ends.items():
                    found.setdefault(name, {}).setdefault(task, []).append(end)
        save(found, a.out)
    print("| robot | " + " | ".join(a.task) + " |\n" + "|---" * (len(a.task) + 1) + "|")
    for name, ends in found.items():
        print(f"| {name} | " + " | ".join(str(sum(ends[task])) for task in a.task) + " |")


if __name__ == "__main__":
    main()
