"""Spaces and arrays of the observation types."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.envs.tasks.task import Situation
from embodiedreamer_gym.robot import RobotModel

OBS_TYPES = ("state", "pixels", "pixels_agent_pos")
SLACK = 0.5  # rad, or share of a gripper's stroke, that an encoder may read beyond a joint's limits
FASTEST = 100.0  # rad/s, bound of a joint's speed in an observation
REACH = 5.0  # m, bound of a position in an observation


def action_space(model: RobotModel) -> spaces.Box:
    """Joint targets (14,): the joints' limits in rad, grippers 0..1."""
    low, high = np.maximum(model.tree.lower, -2 * np.pi), np.minimum(model.tree.upper, 2 * np.pi)
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def joint_space(model: RobotModel) -> spaces.Box:
    """Space of the encoder readings (14,)."""
    action = action_space(model)
    return spaces.Box(action.low - np.float32(SLACK), action.high + np.float32(SLACK), dtype=np.float32)


def state_names(model: RobotModel) -> tuple[str, ...]:
    """Names of the entries of the state vector."""
    names = [f"{joint}.position" for joint in model.joints] + [f"{joint}.velocity" for joint in model.joints]
    for what in (*(f"{arm}" for arm in model.arms), "object", "target"):
        names += [f"{what}.{axis}" for axis in "xyz"]
    return (*names, *(f"object.q{axis}" for axis in "xyzw"), "side")


def state_space(model: RobotModel) -> spaces.Box:
    """Bounds (45,) of the state vector, in the order of `state_names`."""
    joints = joint_space(model)
    places = np.full(12, REACH)
    high = np.concatenate([joints.high, np.full(model.n, FASTEST), places, np.ones(5)])
    low = np.concatenate([joints.low, np.full(model.n, -FASTEST), -places, -np.ones(5)])
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def state_vector(position, velocity, tips, situation: Situation, target: np.ndarray) -> np.ndarray:
    """State (45,): joints' positions and speeds, tips, object, target (m), the object's quaternion, side (left 1)."""
    side = 1.0 if situation.side == "left" else -1.0
    found = situation.object
    return np.concatenate([position, velocity, *tips, found.position, target, found.quaternion, [side]])


def pixel_space(cameras: tuple[str, ...], size: tuple[int, int]) -> spaces.Space:
    """One camera's picture (H, W, 3), or a dictionary of them by name."""
    boxes: dict[str, spaces.Space] = {name: spaces.Box(0, 255, (size[1], size[0], 3), np.uint8) for name in cameras}
    return boxes[cameras[0]] if len(cameras) == 1 else spaces.Dict(boxes)


def clipped(vector: np.ndarray, box: spaces.Box) -> np.ndarray:
    """A vector in single precision, clipped to the space's bounds."""
    return np.minimum(np.maximum(vector, box.low), box.high).astype(np.float32)
