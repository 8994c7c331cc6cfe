"""Simulated frames become real-looking video inside `env.step`; writes frames.png: simulated above, generated below."""

from __future__ import annotations

import cv2
import gymnasium as gym
import numpy as np

import embodiedreamer_gym
from embodiedreamer_gym.vis_aligner import metrics
from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper

gym.register_envs(embodiedreamer_gym)
env = VisAlignerObservationWrapper(gym.make("EmbodieDreamer/PutCupOnMat-v0", image_size=(128, 96)))
observation, info = env.reset(seed=0)
here = env.unwrapped.joint_positions()
goal = here + np.where(np.isin(np.arange(14), (1, 8)), 0.8, 0.0)  # both arms lean forward
simulated, generated = [env.unwrapped.capture().rgb], [observation["pixels"]]
for share in np.linspace(0.2, 1.0, 5):
    actions = np.repeat((here + share * (goal - here))[None], 8, axis=0)
    observation, reward, terminated, truncated, info = env.step(actions.astype(np.float32))
    simulated.append(env.unwrapped.capture().rgb)
    generated.append(observation["pixels"])
env.close()
picture = metrics.strip({"simulated": np.stack(simulated), "generated": np.stack(generated)}, columns=6)
cv2.imwrite("frames.png", picture[..., ::-1])
print("frames.png")
