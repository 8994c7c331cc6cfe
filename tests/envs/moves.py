"""Motions that make contacts: an environment's past, for tests that must not depend on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np

LOW = np.array([-1.2, 1.2, -1.6, 0.0, -0.6, 0.0, 0.0])  # of one arm's joints and gripper
HIGH = np.array([1.2, 2.7, -0.4, 0.0, 1.2, 0.0, 1.0])
STRIDE = 12  # steps to a new pose


def shove(env: gym.Env, rng: np.random.Generator, steps: int) -> Iterator[tuple[Any, float, bool, bool, dict]]:
    """Sweep both arms at random through table and props; what each step returns."""
    here = env.unwrapped.joint_positions()
    while steps > 0:
        goal = np.concatenate([rng.uniform(LOW, HIGH) for _ in range(2)])
        for share in np.arange(1, min(STRIDE, steps) + 1) / STRIDE:
            yield env.step((here + share * (goal - here)).astype(np.float32))
        here, steps = goal, steps - STRIDE


def drain(moves: Iterator[Any]) -> None:
    """Let the moves happen."""
    for _ in moves:
        pass
