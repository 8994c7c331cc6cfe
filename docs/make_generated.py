"""Draw docs/images/vis/<task>.jpg, an expert's episode simulated and generated: python docs/make_generated.py."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np

import embodiedreamer_gym
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.vis_aligner import metrics
from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper

OUT = Path(__file__).parent / "images" / "vis"
SIZE, CHUNKS, SEED = (128, 96), 25, 1


def draw(task: str) -> np.ndarray:
    """A strip (h, w, 3) of six moments, each chunk's reference what was generated before."""
    plain = gym.make(f"EmbodieDreamer/{task}-v0", obs_type="state")
    plain.reset(seed=SEED)
    expert, actions, simulated = ScriptedExpert(plain.unwrapped), [], []
    for _ in range(8 * CHUNKS):
        actions.append(expert.act())
        plain.step(actions[-1])
        simulated.append(plain.unwrapped.capture("head", SIZE).rgb)
    env = VisAlignerObservationWrapper(gym.make(f"EmbodieDreamer/{task}-v0", image_size=SIZE))
    env.reset(seed=SEED)
    chunks = np.array(actions, np.float32).reshape(CHUNKS, 8, -1)
    generated = np.concatenate([env.step(chunk)[4]["frames"] for chunk in chunks])
    plain.close()
    env.close()
    return metrics.strip({"simulated": np.stack(simulated), "generated": generated}, columns=6)


if __name__ == "__main__":
    gym.register_envs(embodiedreamer_gym)
    OUT.mkdir(parents=True, exist_ok=True)
    for name in TASKS:
        save_picture(draw(name), OUT / f"{name}.jpg")
