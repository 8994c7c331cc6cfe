"""Robot models for the environments, and random draws from a calibration's intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import ParameterKey, RobotModel

JOINTS = 14
HOME = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0] * 2)  # rad; grippers open
DEVIATIONS = 3.92  # standard deviations in a 95 % interval


def load_robot(source: str | Path) -> RobotModel:
    """Read a model for an environment: two arms of six joints and a gripper (0..1) each, left arm first.

    Raises: ModelError when the file holds another robot.
    """
    if not isinstance(source, (str, Path)):
        raise ModelError(
            f"robot must be a built-in robot's name or a model file's path, not a {type(source).__name__}."
        )
    model = RobotModel.load(source)
    grippers = [i for i, unit in enumerate(model.units) if unit == "1"]
    if model.n != JOINTS or grippers != [6, 13] or len(model.arms) != 2 or len(model.tree.tips) != 2:
        raise ModelError(
            f"robot {source} has {model.n} joints on {len(model.arms)} arms; the ALOHA environments need 14: 6 and a "
            "normalised gripper for the left arm, then the same for the right, as in the built-in 'aloha'."
        )
    return model


def home(model: RobotModel) -> np.ndarray:
    """Start positions (14,) of the joints."""
    return np.clip(HOME, model.tree.lower, model.tree.upper)


def draw_parameters(model: RobotModel, rng: np.random.Generator) -> dict[ParameterKey, np.ndarray]:
    """Parameter sets (1, joints or arms) from normal distributions, clipped to the calibration's intervals."""
    sets: dict[ParameterKey, np.ndarray] = {}
    rows = {row.name: row for row in model.parameters()}
    for name in sorted(model.intervals):
        low, high = model.intervals[name]
        row = rows.get(name)
        if row is None:
            continue
        drawn = float(np.clip(rng.normal(row.value, (high - low) / DEVIATIONS), max(low, row.low), min(high, row.high)))
        group = row.key.group
        if group not in sets:
            sets[group] = model.group_values(group)[None]
        sets[group][0, row.index] = drawn
    return sets
