"""Least squares of each joint's effort on the terms that every driven joint has: scale, rotor inertia, friction.

In an industrial arm, the friction of the gears is often larger than the weight of the wrist. A factor fitted to the
weight alone is then far off, and may have the wrong sign. Friction determines the sign, because it opposes the motion:
scale, rotor inertia and friction all have the same sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from embodiedreamer_gym.recordings import Recording, smooth, smooth_derivatives, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import run_sets

OWN_SHARE = 0.01  # share of the effort's variance that the model's torque alone must explain to determine the scale


def motion_terms(recording: Recording) -> list[np.ndarray]:
    """Acceleration, speed and sign of the speed (T, n), smoothed twice, like the torques of inverse runs."""
    motion = smooth_derivatives(recording)  # smoothed once
    sign = smooth(recording, np.sign(smooth_motion(recording).velocity))
    return [smooth(recording, x) for x in (motion.acceleration, motion.velocity, sign)]


def joint_terms(
    model: RobotModel, recordings: Sequence[Recording], efforts: Sequence[np.ndarray], usable: Sequence[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Effort (N,) and terms (N, 4) of each joint, both with their mean subtracted.

    The terms are the model's torque without rotor inertia and viscous friction, acceleration, speed and the sign of the
    speed.
    efforts, usable: smoothed efforts and the samples to use, (T, n) per recording.
    """
    bare = model.with_(rotor_inertia=np.zeros(model.n), viscous_friction=np.zeros(model.n))
    runs = run_sets(bare, recordings)
    tables = [np.stack([e, run.torque[0], *motion_terms(r)], axis=-1)
              for e, run, r in zip(efforts, runs, recordings, strict=True)]  # fmt: skip
    joints = []
    for j in range(model.n):
        rows = np.concatenate([t[u[:, j], j] for t, u in zip(tables, usable, strict=True)])
        rows = rows - rows.mean(axis=0) if len(rows) else rows
        joints.append((rows[:, 0], rows[:, 1:]))
    return joints


def effort_per_torque(effort: np.ndarray, terms: np.ndarray, torque_scale: float) -> float:
    """Scale of one joint's effort (N,) relative to the model's torque, by least squares on terms (N, 4) of one sign.

    If the model's torque explains nothing beyond the other terms, efforts are assumed to be as large as a torque
    typical of the joint, in N m.
    """
    if len(effort) <= terms.shape[1] or not np.any(effort):
        return 1.0
    size = np.maximum(np.linalg.norm(terms, axis=0), 1e-300)
    weights, sign = np.zeros(terms.shape[1]), 1.0
    least = np.inf
    for trial in (1.0, -1.0):
        found, left = scipy.optimize.nnls(terms / size, trial * effort)
        if left < least:
            weights, sign, least = found / size, trial, left
    _, without = scipy.optimize.nnls(terms[:, 1:] / size[1:], sign * effort)
    if without**2 - least**2 > OWN_SHARE * float(effort @ effort):
        return float(sign * weights[0])
    return float(sign * np.sqrt(np.mean(effort**2)) / torque_scale)


def start_values(effort: np.ndarray, terms: np.ndarray, scale: float, rotor_known: float | None) -> tuple[float, float]:
    """Rotor inertia and viscous friction of one joint at a given scale, fitted with Coulomb friction; none is negative.

    rotor_known: kg m^2, if the rotor inertia is given.
    """
    if len(effort) <= terms.shape[1]:
        return rotor_known or 0.0, 0.0
    rest = effort / scale - terms[:, 0]
    own = terms[:, 1:]
    if rotor_known is not None:
        rest, own = rest - rotor_known * terms[:, 1], terms[:, 2:]
    size = np.maximum(np.linalg.norm(own, axis=0), 1e-300)
    found = scipy.optimize.nnls(own / size, rest)[0] / size
    return (float(found[0]), float(found[1])) if rotor_known is None else (rotor_known, float(found[0]))
