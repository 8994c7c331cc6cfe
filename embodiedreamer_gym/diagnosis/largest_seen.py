"""Largest speeds, accelerations and torques in recordings; limits near these values begin to act."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import run_sets

SLOPE = 0.1  # s, length of the slopes from which the largest acceleration is computed


def largest_seen(unit: str, model: RobotModel, problem: Problem) -> np.ndarray:
    """Largest value (n,) seen of the quantity that a limit in this unit restricts."""
    if unit == "N m":
        return _top_torque(model, problem)
    return _top_acceleration(problem.recordings) if unit == "rad/s^2" else _top_speed(problem.recordings)


def _top_acceleration(recordings: Sequence[Recording]) -> np.ndarray:
    """Largest measured acceleration (n,), robust: the 99th percentile of differences between slopes over 0.1 s each."""
    found = []
    for r in recordings:
        k = max(1, min(round(SLOPE * r.hz), (len(r.time) - 1) // 2))
        slope = (r.position[k:] - r.position[:-k]) / (r.time[k:] - r.time[:-k])[:, None]
        found.append(np.abs(slope[k:] - slope[:-k]) / (r.time[2 * k :] - r.time[k:-k])[:, None])
    return np.maximum(np.percentile(np.concatenate(found), 99, axis=0), 1e-2)


def _top_speed(recordings: Sequence[Recording]) -> np.ndarray:
    """Largest measured speed (n,), robust: the 99th percentile of slopes over three samples."""
    slopes = [np.abs((r.position[3:] - r.position[:-3]) / (r.time[3:] - r.time[:-3])[:, None]) for r in recordings]
    return np.maximum(np.percentile(np.concatenate(slopes), 99, axis=0), 1e-3)


def _top_torque(model: RobotModel, problem: Problem) -> np.ndarray:
    """Largest torque (n,) of the calibrated model's servo, 99th percentile."""
    runs = run_sets(model, problem.recordings, hold=problem.hold)
    return np.maximum(np.percentile(np.concatenate([np.abs(r.torque[0]) for r in runs]), 99, axis=0), 1e-6)
