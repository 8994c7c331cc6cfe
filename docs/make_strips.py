"""Draw docs/images/tasks/<task>.png, six pictures of a scripted expert's episode each: python docs/make_strips.py."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np
from matplotlib.image import imsave

import embodiedreamer_gym  # noqa: F401  its environments are registered
from embodiedreamer_gym.envs.cameras import Camera, look_at
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS

OUT = Path(__file__).parent / "images" / "tasks"
SIZE = (256, 192)
SEEDS = {"GrabPaperCup": 1, "PutPenInCup": 1, "PutRemoteInBox": 2, "PutCupOnMat": 2}


def onlooker(side: str) -> Camera:
    """A camera across the table from the acting arm."""
    y = 1.0 if side == "left" else -1.0
    position, target = (1.06, 0.66 * y, 1.2), (0.47, 0.29 * y, 0.83)
    return Camera.from_fov("onlooker", position, look_at(position, target), fovy=36.0)


def episode(task: str, seed: int) -> tuple[list[np.ndarray], list[dict]]:
    """Picture and info after each step."""
    env = gym.make(f"EmbodieDreamer/{task}-v0", obs_type="state", render_mode="rgb_array")
    _, info = env.reset(seed=seed)
    aloha, camera, expert = env.unwrapped, onlooker(info["side"]), ScriptedExpert(env)
    pictures, infos, over = [], [], False
    while not over:
        pictures.append(aloha.engine.rgb(camera, SIZE))
        *_, over, info = env.step(expert.act())
        infos.append(info)
    env.close()
    return pictures, infos


def moments(infos: list[dict]) -> list[int]:
    """Steps of the start, the approach, the grasp, the lift, the way to the goal and the end."""
    closed, grasped, done = (
        next(k for k, info in enumerate(infos) if info[key]) for key in ("contacts", "grasp_success", "is_success")
    )
    return [0, round(0.7 * closed), closed + 4, grasped + 6, max((grasped + done) // 2 + 8, grasped + 15), done + 30]


def main() -> None:
    """Write one strip for each task."""
    OUT.mkdir(parents=True, exist_ok=True)
    for task in TASKS:
        pictures, infos = episode(task, SEEDS[task])
        chosen = moments(infos)
        imsave(OUT / f"{task}.png", np.hstack([pictures[k] for k in chosen]), metadata={"Software": ""})
        print(f"{task}: {infos[0]['side']} arm, steps {', '.join(map(str, chosen))}, done {infos[-1]['is_success']}")


if __name__ == "__main__":
    main()
