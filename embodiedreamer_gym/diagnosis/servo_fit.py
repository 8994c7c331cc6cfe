"""Difference between the logged effort and the torque that a model's servo would command along the measured motion.

A servo reacts to its command and the motion that it measures, whatever moves the joint. Friction, loads and wrong
masses do not change this relation; a delay, a dead zone or a limit that the model lacks does. So the effort shows on
which side of the servo a model fails. The torque is that of the free run, corrected to first order by the servo's gains
times the measured minus the simulated motion, so that an error of the simulated motion is not attributed to the servo.

For each joint, the effort's scale (its unit need not be known), a damping and an offset are fitted, because positions
alone attribute viscous friction to damping and wrong masses to stiffness.
Source: Gautier, Janot and Vandanjon, IEEE Transactions on Control Systems Technology 21(2), 2013 (the measured torque
against that of a simulation under the same control law).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from embodiedreamer_gym.recordings import (
    Recording,
    noise_floor,
    sensor_sd,
    smooth_motion,
    smoothing_gain,
    smoothing_half,
)
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation import Rollout
from embodiedreamer_gym.simulation.rollout import command_rule

READ = (-0.5, 0.0, 0.5)  # shares of a held command's step: the effort may be read before, during or after it


@dataclass(frozen=True, eq=False)
class ServoFit:
    """A servo's torque fitted to the effort of recordings.

    residuals: per recording (T, n), in the effort's unit, None if it lacks effort or command; usable: per recording,
    samples (T, n) that were fitted, without both ends, where a smoothed speed is noisier; mean_square (n,): of the
    residuals; variance (n,): of their noise, including that of the position sensor; scale (n,): effort per N m.
    """

    residuals: list[np.ndarray | None]
    usable: list[np.ndarray]
    mean_square: np.ndarray
    variance: np.ndarray
    scale: np.ndarray


def fit_servo(model: RobotModel, recordings: Sequence[Recording], rollouts: Sequence[Rollout]) -> ServoFit | None:
    """Fit scale, damping and offset of each joint's effort to the torque that a model's servo would command.

    None if no recording has both an effort and a command. rollouts: the model's free runs of the recordings, arrays (T,
    n).
    """
    has_both = [r.command is not None and r.effort is not None for r in recordings]
    if not any(has_both):
        return None
    inside = [_usable(r) for r in recordings]
    rollouts, usable = list(compress(rollouts, has_both)), list(compress(inside, has_both))
    recordings = list(compress(recordings, has_both))
    stiffness, damping = (model.group_values(ParameterKey(group)) for group in ("stiffness", "damping"))
    efforts = [np.asarray(r.effort) for r in recordings]
    torques, speeds, steps, seen = [], [], [], []
    for r, run in zip(recordings, rollouts, strict=True):
        gain, off = r.gain * stiffness, r.position - run.position
        turn, command = smooth_motion(r, off).velocity, np.asarray(r.command)
        torques.append(run.torque - gain * off - damping * turn)
        speeds.append(run.velocity + turn)
        held = command_rule(model, r) == "hold"
        steps.append(held * gain * np.diff(command, axis=0, prepend=command[:1]))
        seen.append((r.sigma * gain) ** 2 + (smoothing_gain(r, 1) * r.sigma * damping) ** 2)
    fits = []
    for share in READ if any(step.any() for step in steps) else READ[1:2]:
        terms = [np.stack([t + share * s, v, np.ones_like(v)]) for t, s, v in zip(torques, steps, speeds, strict=True)]
        weights = _least_squares(terms, efforts, usable)
        residuals = [e - np.sum(weights[:, None] * x, axis=0) for e, x in zip(efforts, terms, strict=True)]
        fits.append((residuals, _mean_square(residuals, usable), weights[0]))
    residuals, left, scale = min(fits, key=lambda fit: float(np.sum(np.log(fit[1]))))
    least = 1e-5 * np.max([np.ptp(e, axis=0) for e in efforts], axis=0)
    own = np.maximum(noise_floor([sensor_sd(r.time, e) for r, e in zip(recordings, efforts, strict=True)]), least)
    rest = iter(residuals)
    residuals = [next(rest) if both else None for both in has_both]
    return ServoFit(residuals, inside, left, own**2 + scale**2 * np.mean(seen, axis=0), scale)


def _least_squares(
    terms: Sequence[np.ndarray], efforts: Sequence[np.ndarray], usable: Sequence[np.ndarray]
) -> np.ndarray:
    """Weights (k, n) of terms (k, T, n) in each joint's effort (T, n)."""
    weights = np.zeros((len(terms[0]), terms[0].shape[2]))
    for j in range(weights.shape[1]):
        columns = np.concatenate([x[:, u[:, j], j] for x, u in zip(terms, usable, strict=True)], axis=1).T
        effort = np.concatenate([e[u[:, j], j] for e, u in zip(efforts, usable, strict=True)])
        size = np.sqrt(np.sum(columns**2, axis=0) / max(len(columns), 1)) + 1e-300
        weights[:, j] = np.linalg.lstsq(columns / size, effort, rcond=1e-8)[0] / size
    return weights


def _mean_square(residuals: Sequence[np.ndarray], usable: Sequence[np.ndarray]) -> np.ndarray:
    """Mean square (n,) of residuals (T, n) over the usable samples."""
    squares = np.sum([(x**2 * u).sum(axis=0) for x, u in zip(residuals, usable, strict=True)], axis=0)
    return np.maximum(squares, 1e-300) / np.maximum(np.sum([u.sum(axis=0) for u in usable], axis=0), 1)


def _usable(recording: Recording) -> np.ndarray:
    half, usable = smoothing_half(recording), recording.usable.copy()
    usable[:half] = usable[-half:] = False
    return usable
