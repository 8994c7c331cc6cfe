"""What a model is held against: the measured signals of recordings, each with its noise.

A channel is one joint's signal: its position in a free run, or, where no log holds a command, its effort in an inverse
run. What a log's effort shows of a torque is the model's `EffortSensor`: an offset of each joint, and where the effort
is not in N m, a scale.
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

LARGEST = 1e6  # sensor noises; a run that diverges is no further off
PLAUSIBLE = 1.5  # the scale of an effort whose unit is unknown, in the median over joints, up to which it is N m
POSES = 16  # of a recording, from which the noise of its inverse run is estimated
SHORT = 2  # samples to either side that a reversal rests at most


class Signals:
    """The channels (n,) of recordings and how far runs of a model are from them.

    unit: "" for positions in the joints' own units, else the effort's, "N m" or "A"; sigma (n,): noise of a channel, in its
    unit; usable: per recording, samples (T, n) that are compared; measured: per recording, the smoothed effort (T, n), where
    efforts are compared.
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
        """Measured less simulated (P, T, n) of runs (P, T, n), in the channels' units."""
        pairs = list(zip(self.recordings, rollouts, strict=True))
        if not self.by_effort:
            return [r.position - run.position for r, run in pairs]
        return [e - run.effort for e, run in zip(self.measured, rollouts, strict=True)]

    def runs(
        self, model: RobotModel, sets: Sets | None = None, hold: str | None = None, dt: float = TIME_STEP
    ) -> list[Rollout]:
        """What a model makes of the recordings under P parameter sets, as their clocks would have stamped it.

        The clock's part is linear in its jitter: of the jitter that an arm's joints show, the run on mended stamps is it.
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
        """Largest rms residual over the joints, relative to the floor (n,), that a typical size of an effect leaves.

        simulated: what a run with the effect shows. Of a clock's errors a run shows only those that these logs have, so
        they are taken from the joints' speeds.
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
        """Of each arm, the jitter that its joints show, s, and the recordings on stamps without it."""
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
        """Residuals (P, N) of the usable samples in sensor noises, under P parameter sets of a model."""
        errors = self.errors(self.runs(model, sets, hold, dt))
        parts = [(error / self.sigma)[:, usable] for error, usable in zip(errors, self.usable, strict=True)]
        return np.clip(np.concatenate(parts, axis=1), -LARGEST, LARGEST)


def with_effort_unit(model: RobotModel, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings whose effort has a unit: what they state, else N m where the model's torque is about as large, else A.

    Raises: SimulationError when a recording is not of this robot or holds no effort.
    """
    if not any(r.command is None and r.effort_unit == "unknown" for r in recordings):
        return tuple(recordings)
    scaled = ParameterKey("scale", EffortSensor.name) in {row.key.group for row in model.parameters()}
    scale = np.inf if scaled else float(np.median(np.abs(_effort_lines(model, recordings)[0])))
    unit = "N m" if 1 / PLAUSIBLE < scale < PLAUSIBLE else "A"
    return tuple(r.with_(effort_unit=unit) for r in recordings)


def with_effort_scale(model: RobotModel, recordings: Sequence[Recording]) -> RobotModel:
    """The model with an `EffortSensor` where its logs have no command and their effort is not in N m."""
    if all(r.command is not None or r.effort_unit == "N m" for r in recordings):
        return model
    return with_effort_sensor(model, recordings)


def with_effort_sensor(model: RobotModel, recordings: Sequence[Recording]) -> RobotModel:
    """The model with an `EffortSensor` where its logs have no command: least squares of effort on the model's torque.

    A model that has one keeps it; so does a model whose logs hold commands. The scale of efforts in N m is one.
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
    """Scale (n,) and offset (n,) of each joint's effort against the model's torque, see `effort_per_torque`."""
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
    """The run that lies a share (P, 1, n) of the way from one to the other."""
    signals = ((a.position, b.position), (a.velocity, b.velocity), (a.torque, b.torque))
    return Rollout(a.time, *(x + share * (y - x) for x, y in signals))


def _rising(time: np.ndarray) -> np.ndarray:
    """Times (T,), each at least a little after the one before."""
    least = 0.02 * float(np.median(np.diff(time))) * np.arange(len(time))
    return np.maximum.accumulate(time - least) + least


def _smoothed_effort(recording: Recording) -> np.ndarray:
    """Effort (T, n) that has passed the filter of inverse runs."""
    return smooth(recording, smooth(recording, np.asarray(recording.effort)))


def _unknown(recording: Recording) -> np.ndarray:
    """Samples (T, n) whose friction is not known: at a rest or a reversal, and beside it; both ends.

    How long a joint stood still at a reversal is known no better than to the window of the filter.
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
    """Samples (T, n) and as many beside them to either side."""
    return np.asarray(maximum_filter1d(samples.astype(np.int8), 2 * by + 1, axis=0) > 0)


def effort_scale(model: RobotModel) -> np.ndarray:
    """Effort per torque (n,) of a model's `EffortSensor`, 1 where it has none."""
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
    """Noise (n,) of a smoothed effort against an inverse run: the effort's own and that of the acceleration.

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
