"""The measured signals that a model is compared with, each with its noise.

A channel is one joint's signal: its position in a free run or, if no log contains a command, its effort in an inverse
run. The model's `EffortSensor` describes how an effort in a log depends on the torque: by an offset of each joint and,
if the effort is not in N m, a scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.phys_aligner.effort_terms import effort_per_torque, joint_terms
from embodiedreamer_gym.recordings import (
    Recording,
    noise_floor,
    sensor_sd,
    smooth,
    smooth_derivatives,
    smooth_motion,
    smoothing_half,
    stamp_errors,
    twice_smoothed_gain,
)
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation import TIME_STEP, Drive, Rollout, Sets, resting, run_sets

LARGEST = 1e6  # units of sensor noise; larger errors of a diverging run are clipped
PLAUSIBLE = 1.5  # median over joints of an unknown effort's scale, up to which its unit is N m
POSES = 16  # poses of a recording from which the noise of its inverse run is estimated
SHORT = 2  # longest rest at a reversal, in samples to either side


class Signals:
    """The channels (n,) of recordings, and the errors of a model's runs relative to them.

    unit: "" for positions in the joints' own units, else the effort's, "N m" or "A"; sigma (n,): noise of a channel, in
    its unit; usable: per recording, samples (T, n) that are compared; measured: per recording, the smoothed effort
    (T, n), if efforts are compared.
    """

    def __init__(self, model: RobotModel, recordings: Sequence[Recording]) -> None:
        self.recordings = tuple(recordings)
        self.by_effort = any(r.command is None for r in recordings)
        self.unit, self._arm = "", model.tree.arm
        self.measured: list[np.ndarray] = []
        if not self.by_effort:
            self.sigma = noise_floor([r.sigma for r in recordings])
            self.usable = [r.usable for r in recordings]
            return
        self.recordings = with_effort_unit(model, recordings)
        self.unit = self.recordings[0].effort_unit
        self.measured = [_smoothed_effort(r) for r in self.recordings]
        self.usable = [r.usable & ~_unknown(r) for r in self.recordings]
        self.sigma = _effort_noise(model, self.recordings, effort_scale(model))

    def errors(self, rollouts: Sequence[Rollout]) -> list[np.ndarray]:
        """Measured minus simulated (P, T, n) of runs (P, T, n), in the channels' units."""
        pairs = list(zip(self.recordings, rollouts, strict=True))
        if not self.by_effort:
            return [r.position - run.position for r, run in pairs]
        return [e - run.effort for e, run in zip(self.measured, rollouts, strict=True)]

    def runs(
        self, model: RobotModel, sets: Sets | None = None, hold: str | None = None, dt: float = TIME_STEP
    ) -> list[Rollout]:
        """Runs of a model on the recordings under P parameter sets, with the timestamp jitter of the logs' clocks.

        The timing error is linear in the jitter: a run on corrected timestamps has the full jitter that an arm's joints
        show, and the error of any other jitter is scaled from it.
        """
        runs = run_sets(model, self.recordings, sets, hold, dt)
        if self.by_effort or not any(effect.stage == "clock" for effect in model.effects):
            return runs
        jitter = Drive(model, sets).clock_jitter()
        for arm in np.flatnonzero(jitter.any(axis=0)).tolist():
            shown, mended = self._clocks[arm]
            if shown > 0:
                share = (self._arm == arm) * jitter[:, arm, None, None] / shown
                other = run_sets(model, mended, sets, hold, dt)
                runs = [_between(a, b, share) for a, b in zip(runs, other, strict=True)]
        return runs

    def visible(self, kind: type[Effect], simulated: float, floor: np.ndarray) -> float:
        """Largest rms residual over the joints, relative to the floor (n,), that a typical size of an effect causes.

        simulated: the residual in a run with the effect. A run shows only those errors of a clock that these logs have,
        so these errors are computed from the joints' speeds.
        """
        if kind.stage != "clock":
            return simulated
        if self.by_effort:
            return 0.0
        speeds = np.concatenate([smooth_motion(r).velocity for r in self.recordings])
        rms = kind.parameters[0].typical * np.sqrt(np.mean(speeds**2, axis=0)) / self.sigma
        return float((rms / np.maximum(floor, 1.0)).max())

    @cached_property
    def _clocks(self) -> list[tuple[float, list[Recording]]]:
        """For each arm, the jitter (s) that its joints show, and the recordings with timestamps without it."""
        clocks = []
        for arm in range(int(self._arm.max()) + 1):
            own = [r.joints[j] for r in self.recordings[:1] for j in np.flatnonzero(self._arm == arm)]
            shown, late = stamp_errors([r.only(own) for r in self.recordings])
            mended = [r.with_(time=_rising(r.time - d)) for r, d in zip(self.recordings, late, strict=True)]
            clocks.append((shown, mended if shown > 0 else []))
        return clocks

    def residuals(
        self, model: RobotModel, sets: Sets | None = None, hold: str | None = None, dt: float = TIME_STEP
    ) -> np.ndarray:
        """Residuals (P, N) of the usable samples in units of sensor noise, under P parameter sets of a model."""
        errors = self.errors(self.runs(model, sets, hold, dt))
        parts = [(error / self.sigma)[:, usable] for error, usable in zip(errors, self.usable, strict=True)]
        return np.clip(np.concatenate(parts, axis=1), -LARGEST, LARGEST)


def with_effort_unit(model: RobotModel, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings whose effort has a unit: as stated, else N m if the model's torque has about the same size, else A.

    Raises: SimulationError if a recording is not of this robot or contains no effort.
    """
    if not any(r.command is None and r.effort_unit == "unknown" for r in recordings):
        return tuple(recordings)
    scaled = ParameterKey("scale", EffortSensor.name) in {row.key.group for row in model.parameters()}
    scale = np.inf if scaled else float(np.median(np.abs(_effort_lines(model, recordings)[0])))
    unit = "N m" if 1 / PLAUSIBLE < scale < PLAUSIBLE else "A"
    return tuple(r.with_(effort_unit=unit) for r in recordings)


def with_effort_scale(model: RobotModel, recordings: Sequence[Recording]) -> RobotModel:
    """The model with an `EffortSensor` if its logs have no command and their effort is not in N m."""
    if all(r.command is not None or r.effort_unit == "N m" for r in recordings):
        return model
    return with_effort_sensor(model, recordings)


def with_effort_sensor(model: RobotModel, recordings: Sequence[Recording]) -> RobotModel:
    """The model with an `EffortSensor` if its logs have no command, by least squares of effort on the model's torque.

    A model that already has one, or whose logs contain commands, is returned unchanged. The scale of efforts in N m is
    one.
    """
    if all(r.command is not None for r in recordings) or model.has_effect(EffortSensor):
        return model
    recordings = with_effort_unit(model, recordings)
    if recordings[0].effort_unit == "N m":
        return model.with_effect(
            EffortSensor(offset=dict.fromkeys(model.joints, 0.0), delay=dict.fromkeys(model.arms, 0.0))
        )
    scale, offset = _effort_lines(model, recordings)
    values = {
        name: dict(zip(model.joints, x.tolist(), strict=True)) for name, x in (("scale", scale), ("offset", offset))
    }
    return model.with_effect(EffortSensor(**values, delay=dict.fromkeys(model.arms, 0.0)))


def _effort_lines(model: RobotModel, recordings: Sequence[Recording]) -> tuple[np.ndarray, np.ndarray]:
    """Scale (n,) and offset (n,) of each joint's effort relative to the model's torque, see `effort_per_torque`."""
    runs = run_sets(model, recordings)
    efforts = [_smoothed_effort(r) for r in recordings]
    usable = [r.usable & ~_unknown(r) for r in recordings]
    terms = joint_terms(model, recordings, efforts, usable)
    scale = np.array([effort_per_torque(*own, size) for own, size in zip(terms, model.torque_scale, strict=True)])
    rest = np.concatenate([e - scale * run.torque[0] for e, run in zip(efforts, runs, strict=True)])
    keep = np.concatenate(usable)
    offset = np.sum(rest * keep, axis=0) / np.maximum(keep.sum(axis=0), 1)
    return scale, offset


def _between(a: Rollout, b: Rollout, share: np.ndarray) -> Rollout:
    """The run at a share (P, 1, n) of the way from one run to the other."""
    signals = ((a.position, b.position), (a.velocity, b.velocity), (a.torque, b.torque))
    return Rollout(a.time, *(x + share * (y - x) for x, y in signals))


def _rising(time: np.ndarray) -> np.ndarray:
    """Times (T,), each at least slightly after the previous one."""
    least = 0.02 * float(np.median(np.diff(time))) * np.arange(len(time))
    return np.maximum.accumulate(time - least) + least


def _smoothed_effort(recording: Recording) -> np.ndarray:
    """Effort (T, n) after the filter of inverse runs."""
    return smooth(recording, smooth(recording, np.asarray(recording.effort)))


def _unknown(recording: Recording) -> np.ndarray:
    """Samples (T, n) whose friction is not known: at and near a rest or a reversal, and at both ends.

    The duration of a rest at a reversal is known only to within the window of the filter.
    """
    still, half = resting(recording), smoothing_half(recording)
    forward = smooth_motion(recording).velocity > 0
    turning = still.copy()
    turning[1:] |= forward[1:] != forward[:-1]
    long = still.copy()
    for k in range(1, SHORT + 1):
        long[k:-k] &= still[2 * k :] & still[: -2 * k]
    wide = _widened(turning, half) | _widened(long, 2 * half + SHORT)
    wide[: 2 * half] = wide[-2 * half :] = True
    return wide


def _widened(samples: np.ndarray, by: int) -> np.ndarray:
    """Mask of samples (T, n), extended by this many samples to either side."""
    return np.asarray(maximum_filter1d(samples.astype(np.int8), 2 * by + 1, axis=0) > 0)


def effort_scale(model: RobotModel) -> np.ndarray:
    """Effort per torque (n,) of a model's `EffortSensor`, 1 if it has none."""
    if not model.has_effect(EffortSensor):
        return np.ones(model.n)
    return model.group_values(ParameterKey("scale", EffortSensor.name))


def effort_scales(
    measured: Sequence[np.ndarray], runs: Sequence[np.ndarray], usable: Sequence[np.ndarray]
) -> np.ndarray:
    """Effort per torque (P, 1, n), least squares through the origin over the usable samples."""
    product = sum(np.sum(e * t * u, axis=1, keepdims=True) for e, t, u in zip(measured, runs, usable, strict=True))
    power = sum(np.sum(t * t * u, axis=1, keepdims=True) for t, u in zip(runs, usable, strict=True))
    return np.asarray(product) / np.maximum(power, 1e-300)


def _effort_noise(model: RobotModel, recordings: Sequence[Recording], scale: np.ndarray) -> np.ndarray:
    """Noise (n,) of a smoothed effort minus an inverse run: that of the effort itself and of the acceleration.

    scale (n,): effort per torque.
    """
    mechanics, noises = Drive(model).mechanics, []
    for r in recordings:
        motion = smooth_derivatives(r)
        rows = np.linspace(0, len(r.time) - 1, POSES).astype(int)
        q, v = (np.ascontiguousarray(x[rows]) for x in (motion.position, motion.velocity))
        mass = model.bodies.mass_matrix_and_bias(q, v, mechanics)[0] + np.diag(mechanics.rotor_inertia[0])
        bend = np.sqrt(np.mean((mass * motion.acceleration_noise) ** 2, axis=0).sum(axis=1))
        own = twice_smoothed_gain(r) * sensor_sd(r.time, np.asarray(r.effort))
        least = 1e-5 * np.ptp(np.asarray(r.effort), axis=0)
        noises.append(np.sqrt(own**2 + (bend * scale) ** 2 + least**2))
    return np.sqrt(np.mean(np.square(noises), axis=0))
