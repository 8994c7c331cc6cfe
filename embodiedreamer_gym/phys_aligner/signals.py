"""What a model is held against: the measured signals of recordings, each with its noise.

A channel is one joint's signal: its position in a free run, or, where no log holds a command, its effort in an inverse
run. Where a log's effort is not in N m, each joint's is compared with the model's torque times a scale, found by least
squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d

from embodiedreamer_gym.recordings import (
    Recording,
    noise_floor,
    sensor_sd,
    smooth_motion,
    smoothing_gain,
    smoothing_half,
)
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive, Rollout, Sets, resting, run_sets

LARGEST = 1e6  # sensor noises; a run that diverges is no further off
PLAUSIBLE = 1.5  # the scale of an effort whose unit is unknown, in the median over joints, up to which it is N m
POSES = 16  # of a recording, from which the noise of its inverse run is found
SHORT = 2  # samples to either side that a reversal rests at most


class Signals:
    """The channels (n,) of recordings and how far runs of a model are from them.

    unit: "" for positions in the joints' own units, else the effort's, "N m" or "A"; sigma (n,): noise of a channel, in its
    unit; usable: per recording, samples (T, n) that are compared.
    """

    def __init__(self, model: RobotModel, recordings: Sequence[Recording]) -> None:
        self.recordings = tuple(recordings)
        self.by_effort = any(r.command is None for r in recordings)
        self.unit = ""
        if not self.by_effort:
            self.sigma = noise_floor([r.sigma for r in recordings])
            self.usable = [r.usable for r in recordings]
            return
        self.recordings = with_effort_unit(model, recordings)
        self.unit = self.recordings[0].effort_unit
        self._measured = [_smoothed_effort(r) for r in self.recordings]
        self.sigma = _effort_noise(model, self.recordings)
        self.usable = [r.usable & ~_unknown(r) for r in self.recordings]

    def errors(self, rollouts: Sequence[Rollout]) -> list[np.ndarray]:
        """Measured less simulated (P, T, n) of runs (P, T, n), in the channels' units."""
        pairs = list(zip(self.recordings, rollouts, strict=True))
        if not self.by_effort:
            return [r.position - run.position for r, run in pairs]
        runs = [run.torque for run in rollouts]
        scale = _scales(self._measured, runs, self.usable) if self.unit == "A" else 1.0
        return [e - scale * run for e, run in zip(self._measured, runs, strict=True)]

    def residuals(self, model: RobotModel, sets: Sets | None = None, hold: str | None = None) -> np.ndarray:
        """Residuals (P, N) of the usable samples in sensor noises, under P parameter sets of a model."""
        errors = self.errors(run_sets(model, self.recordings, sets, hold))
        parts = [(error / self.sigma)[:, usable] for error, usable in zip(errors, self.usable, strict=True)]
        return np.clip(np.concatenate(parts, axis=1), -LARGEST, LARGEST)


def with_effort_unit(model: RobotModel, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings whose effort has a unit: what they state, else N m where the model's torque is about as large, else A.

    Raises: SimulationError when a recording is not of this robot or holds no effort.
    """
    if not any(r.command is None and r.effort_unit == "unknown" for r in recordings):
        return tuple(recordings)
    runs = [run.torque for run in run_sets(model, recordings)]
    usable = [r.usable & ~_unknown(r) for r in recordings]
    scale = float(np.median(_scales([_smoothed_effort(r) for r in recordings], runs, usable)))
    unit = "N m" if 1 / PLAUSIBLE < scale < PLAUSIBLE else "A"
    return tuple(r.with_(effort_unit=unit) for r in recordings)


def _smoothed_effort(recording: Recording) -> np.ndarray:
    return smooth_motion(recording, recording.effort).position


def _unknown(recording: Recording) -> np.ndarray:
    """Samples (T, n) whose friction is not known: at a rest, and beside one that outlasts a reversal; both ends."""
    still, half = resting(recording), smoothing_half(recording)
    long = still.copy()
    for k in range(1, SHORT + 1):
        long[k:-k] &= still[2 * k :] & still[: -2 * k]
    wide = still | (maximum_filter1d(long.astype(np.int8), 2 * (half + SHORT) + 1, axis=0) > 0)
    wide[:half] = wide[-half:] = True
    return wide


def _scales(measured: Sequence[np.ndarray], runs: Sequence[np.ndarray], usable: Sequence[np.ndarray]) -> np.ndarray:
    """Effort per torque (P, 1, n), least squares through the origin over the usable samples."""
    product = sum(np.sum(e * t * u, axis=1, keepdims=True) for e, t, u in zip(measured, runs, usable, strict=True))
    power = sum(np.sum(t * t * u, axis=1, keepdims=True) for t, u in zip(runs, usable, strict=True))
    return np.asarray(product) / np.maximum(power, 1e-300)


def _effort_noise(model: RobotModel, recordings: Sequence[Recording]) -> np.ndarray:
    """Noise (n,) of a smoothed effort against an inverse run: the effort's own and that of the acceleration."""
    mechanics, found = Drive(model).mechanics, []
    for r in recordings:
        motion = smooth_motion(r)
        rows = np.linspace(0, len(r.time) - 1, POSES).astype(int)
        q, v = (np.ascontiguousarray(x[rows]) for x in (motion.position, motion.velocity))
        mass = model.bodies.mass_matrix_and_bias(q, v, mechanics)[0] + np.diag(model.rotor_inertia)
        bend = np.sqrt(np.mean((mass * motion.acceleration_noise) ** 2, axis=0).sum(axis=1))
        own = smoothing_gain(r) * sensor_sd(r.time, np.asarray(r.effort))
        least = 1e-5 * np.ptp(np.asarray(r.effort), axis=0)
        scale = (
            1.0
            if r.effort_unit == "N m"
            else np.std(np.asarray(r.effort), axis=0) / np.maximum(model.torque_scale, 1e-9)
        )
        found.append(np.sqrt(own**2 + (bend * scale) ** 2 + least**2))
    return np.sqrt(np.mean(np.square(found), axis=0))
