"""Error of the end effectors' motion: the paper's translation and rotation losses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.geometry.pose_error import rotation_error, translation_error
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.forward_kinematics import EndEffector
from embodiedreamer_gym.simulation import Rollout


def trajectory_losses(
    model: RobotModel, recordings: Sequence[Recording], rollouts: Sequence[Rollout]
) -> tuple[float, float]:
    """Translation error in m and rotation error in rad, means over time and arms; nan if no sample is usable."""
    totals, weight = np.zeros(2), 0
    for arm, link in enumerate(model.tree.tips):
        end = EndEffector(model.urdf, link)
        own = [j for j in range(model.n) if model.tree.arm[j] == model.tree.arm[_driver(model, arm)]]
        for recording, run in zip(recordings, rollouts, strict=True):
            keep = recording.usable[:, own].all(axis=1)
            if not keep.any():
                continue
            measured, simulated = (tip_poses(end, model, q[keep]) for q in (recording.position, run.position))
            errors = translation_error(simulated[0], measured[0]), rotation_error(simulated[1], measured[1])
            totals, weight = totals + keep.sum() * np.array(errors), weight + int(keep.sum())
    return tuple(totals / weight) if weight else (np.nan, np.nan)


def _driver(model: RobotModel, tip: int) -> int:
    """The driven joint nearest to an end effector."""
    body = list(model.tree.tips.values())[tip][0]
    return int(model.tree.coordinate[body])


def tip_poses(end: EndEffector, model: RobotModel, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a link at joint positions (T, n) in the model's units; joints not driven stay at zero."""
    values = position.copy()
    for joint, (zero, one) in model.normalised.items():
        column = model.joints.index(joint)
        values[:, column] = zero + position[:, column] * (one - zero)
    undriven = [j for j in end.joints if j not in model.tree.joint_names]
    return end.pose(np.hstack([values, np.zeros((len(values), len(undriven)))]), (*model.joints, *undriven))
