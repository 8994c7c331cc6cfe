"""Poses of a gripper: it points along z of its end effector's frame and closes along y."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.envs.tasks.task import Situation
from embodiedreamer_gym.geometry.pose import Pose


def outward(situation: Situation, point: np.ndarray, pitch: float) -> Pose:
    """The gripper at a point (3,), pointing away from its arm's base and down by a pitch, rad; it closes sideways."""
    x, y = (point - situation.base)[:2] / np.linalg.norm((point - situation.base)[:2])
    ahead = np.array([x * np.cos(pitch), y * np.cos(pitch), -np.sin(pitch)])
    return _pose(point, ahead, np.array([-y, x, 0.0]))


def downward(point: np.ndarray, across: np.ndarray) -> Pose:
    """The gripper at a point (3,), pointing straight down; it closes along the horizontal part of `across` (3,)."""
    flat = across * [1.0, 1.0, 0.0]
    return _pose(point, np.array([0.0, 0.0, -1.0]), flat / np.linalg.norm(flat))


def ways(situation: Situation, point: np.ndarray, across: np.ndarray) -> tuple[float, float]:
    """Signs of an axis (3,) along which the gripper may close at a point (3,): first the one that turns it less.

    In a picture, the direction of an object's axis is easy to see, but its two ends are hard to tell apart. An expert
    that distinguishes the ends would show a policy two ways of doing the same, and the policy would learn their mean.
    """
    x, y = (point - situation.base)[:2]
    sign = 1.0 if across[:2] @ (-y, x) >= 0.0 else -1.0  # as in `outward`
    return sign, -sign


def _pose(point: np.ndarray, ahead: np.ndarray, across: np.ndarray) -> Pose:
    (a, b, c), (d, e, f) = across.tolist(), ahead.tolist()
    down = (b * f - c * e, c * d - a * f, a * e - b * d)  # across x ahead
    return Pose.of(point, np.array([down, across, ahead]).T)
