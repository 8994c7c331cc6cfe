"""The scripted expert's actions, replayed open-loop on the stand-in's bench: how much the hidden effects matter.

python -m benchmarks standin_replay [--episodes 20] [--task NAME ...] [--out FILE.json]

The expert plays in `AlohaEnv`; its actions are then played in `StandInEnv` from the same seeds, whatever happens there.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closed_loop import TASKS, hidden
from benchmarks.common import pin_threads, save

STEPS = 300


def robots() -> dict[str, dict[str, Any] | None]:
    """Hidden effects by what they are called; None for AlohaEnv itself."""
    arm = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0] * 2)  # not the grippers, whose torque is N m per stroke
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, len(arm)) * arm

    def faulty(friction: float, uneven: float) -> dict[str, Any]:
        return {"coulomb_friction": {"torque": friction * arm}, "torque_constant": {"gain": 1.0 + uneven * drawn},
                "command_delay": {"seconds": 0.02}}  # fmt: skip

    return {
        "in `AlohaEnv` itself": None,
        "no effects, own errors (`seed_of_robot=0`)": {},
        "friction 0.3 N m, drives of 0.8 to 1.2 times their torque, 20 ms late": faulty(0.3, 0.2),
        "friction 0.5 N m, drives of 0.6 to 1.4 times their torque, 20 ms late": faulty(0.5, 0.4),
        "that of `closed_loop`: friction 0.8 N m, drives of 0.5 to 1.5 times their torque, 30 ms late": hidden(),
    }


def main() -> None:
    """Print successes by robot and task."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--task", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    pin_threads()
    from embodiedreamer_gym.envs.aloha import AlohaEnv
    from embodiedreamer_gym.envs.experts import ScriptedExpert
    from embodiedreamer_gym.standin.bench import StandInEnv

    names, found = robots(), {}
    for task in a.task:
        plain = AlohaEnv(task, obs_type="state")
        worlds = {
            name: StandInEnv(task, effects, pictures="none") for name, effects in names.items() if effects is not None
        }
        for seed in range(a.episodes):
            plain.reset(seed=seed)
            expert, actions, info = ScriptedExpert(plain), [], {}
            for _ in range(STEPS):
                actions.append(expert.act())
                info = plain.step(actions[-1])[4]
            ends = {"in `AlohaEnv` itself": info["is_success"]}
            for name, world in worlds.items():
                world.reset(seed=seed)
                for start in range(0, STEPS, world.chunk):
                    info = world.step(np.array(actions[start : start + world.chunk]))[4]
                ends[name] = info["is_success"]
            for name, success in ends.items():
                found.setdefault(name, {}).setdefault(task, []).append(bool(success))
        save(found, a.out)
    print("| robot | " + " | ".join(a.task) + " |\n" + "|---" * (len(a.task) + 1) + "|")
    for name in names:
        print(f"| {name} | " + " | ".join(str(sum(found[name][task])) for task in a.task) + " |")


if __name__ == "__main__":
    main()
