"""Common baseline for logs without commands: least squares of each joint's effort on a few terms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.effort_terms import motion_terms
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording, smooth, smooth_derivatives
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive

TERMS = "rigid torque, rotor inertia, viscous and Coulomb friction, offset"


def least_squares_rms(model: RobotModel, train: Sequence[Recording], test: Sequence[Recording]) -> np.ndarray:
    """Held-out root mean square error (n,) of plain least squares, in the effort's unit.

    Each joint's effort is regressed on `TERMS`: the rigid bodies' torque of the URDF (its factor is one if the effort
    is in N m), acceleration, speed, the sign of the speed and a constant. Samples and smoothing are those of `Signals`.
    """
    learn, judge = Signals(model, train), Signals(model, test)
    pairs = []
    for signals in (learn, judge):
        tables = [_terms(model, r, e) for r, e in zip(signals.recordings, signals.measured, strict=True)]
        pairs.append([np.concatenate([t[:, j][u[:, j]] for t, u in zip(tables, signals.usable, strict=True)])
                      for j in range(model.n)])  # fmt: skip
    rms = np.full(model.n, np.nan)
    for j, (old, new) in enumerate(zip(*pairs, strict=True)):
        if not len(old) or not len(new):
            continue
        if learn.unit == "N m":
            old, new = (np.column_stack([t[:, 0] - t[:, 1], t[:, 2:]]) for t in (old, new))
        weights = np.linalg.lstsq(old[:, 1:], old[:, 0], rcond=None)[0]
        rms[j] = np.sqrt(np.mean((new[:, 0] - new[:, 1:] @ weights) ** 2))
    return rms


def _terms(model: RobotModel, recording: Recording, effort: np.ndarray) -> np.ndarray:
    """Effort and terms (T, n, 6), all smoothed in the same way."""
    motion = smooth_derivatives(recording)
    q, v, a = motion.position, motion.velocity, motion.acceleration
    rigid = model.bodies.inverse_dynamics(q, v, a, Drive(model).mechanics)[0]
    return np.stack([effort, smooth(recording, rigid), *motion_terms(recording), np.ones_like(v)], axis=-1)
