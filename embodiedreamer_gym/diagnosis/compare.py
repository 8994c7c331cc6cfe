"""compare: compare the motion that models predict for the recorded commands with the measured motion.

If no recording has a command, the effort that a model needs for the measured motion is compared instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.comparison import Comparison, Row, measured_less_simulated
from embodiedreamer_gym.diagnosis.regimes import REGIMES, regimes
from embodiedreamer_gym.diagnosis.servo_fit import fit_servo
from embodiedreamer_gym.diagnosis.trajectory_error import trajectory_losses
from embodiedreamer_gym.effects import NUISANCES
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.phys_aligner.signals import Signals, effort_scales, with_effort_scale, with_effort_unit
from embodiedreamer_gym.recordings import Recording, as_recordings, noise_floor, sensor_sd
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Rollout

DIVERGED = 900.0  # rad/s; the simulation clips speeds slightly above this


def compare(
    models: RobotModel | Sequence[RobotModel],
    recordings: Recording | Sequence[Recording],
    labels: Sequence[str] | None = None,
) -> Comparison:
    """Simulate every recording with each model (free run) and compare the error with the sensor noise.

    models: one model or several.
    recordings: one or several, of the models' robot.
    labels: names of the models, all different; default: their own names and the effects by which they differ.
    Raises: SimulationError if a recording is not of this robot, RecordingError if there is nothing to compare.
    """
    models = (models,) if isinstance(models, RobotModel) else tuple(models)
    recordings = as_recordings(recordings)
    if not models or not recordings:
        raise RecordingError("there is nothing to compare; give at least one model and one recording.")
    recordings = with_effort_unit(models[0], recordings)
    models = tuple(with_effort_scale(model, recordings) for model in models)
    if not any(r.usable.any() for r in recordings):
        raise RecordingError("no usable sample is left to compare: all samples are in contact or faulty.")
    rollouts = tuple(free_runs(model, recordings) for model in models)
    labels = _labels(models) if labels is None else tuple(labels)
    masks = [regimes(models[0], r) for r in recordings]
    signals = [Signals(models[0], recordings)]
    by_effort = signals[0].by_effort  # then the noise depends on the inertia of each model
    signals += [Signals(model, recordings) if by_effort else signals[0] for model in models[1:]]
    table = [
        row
        for label, model, its, runs in zip(labels, models, signals, rollouts, strict=True)
        for signal in _signals(model, its, runs)
        for row in _rows(label, model, signal, masks)
    ]
    compared = "effort" if by_effort else "position"
    rms, chi2 = (np.full((len(models), models[0].n), np.nan) for _ in range(2))
    for row in table:
        if (row.signal, row.regime) == (compared, "all"):
            place = labels.index(row.model), models[0].joints.index(row.joint)
            rms[place], chi2[place] = row.rms, row.chi2
    losses = [
        (np.nan, np.nan) if by_effort else trajectory_losses(m, recordings, runs)
        for m, runs in zip(models, rollouts, strict=True)
    ]
    diverged = [any(np.abs(run.velocity).max() > DIVERGED for run in runs) for runs in rollouts]
    return Comparison(labels, models, recordings, rollouts, tuple(signals), tuple(table), rms, chi2, np.array(losses),
                      np.array(diverged))  # fmt: skip


def free_runs(model: RobotModel, recordings: Sequence[Recording]) -> tuple[Rollout, ...]:
    """Free runs of recordings with one model (inverse runs if no log has a command); arrays (T, n)."""
    runs = Signals(model, recordings).runs(model)
    return tuple(run.at(0) for run in runs)


def joint_rms(signals: Signals, rollouts: Sequence[Rollout]) -> np.ndarray:
    """Root mean square error (n,) of one model at each joint over all usable samples, as in `Comparison.joint_rms`.

    rollouts: of the signals' recordings, arrays (T, n). The result is nan where a joint has no usable sample.
    """
    squares, count = _sums(measured_less_simulated(signals, rollouts), signals.usable)
    return np.sqrt(squares / np.where(count > 0, count, np.nan))


def effort_scale(recordings: Sequence[Recording], rollouts: Sequence[Rollout]) -> np.ndarray:
    """Effort per model torque (n,), least squares through the origin over the usable samples."""
    logs = [(r.effort, run.torque[None], r.usable) for r, run in zip(recordings, rollouts, strict=True)
            if r.effort is not None]  # fmt: skip
    efforts, torques, usable = zip(*logs, strict=True)
    return effort_scales(efforts, torques, usable)[0, 0]


@dataclass(frozen=True, eq=False)
class _Signal:
    """Errors (T, n) of one signal per recording (None if a recording lacks the signal), and its noise (n,)."""

    name: str
    units: tuple[str, ...]
    errors: list[np.ndarray | None]
    sigma: np.ndarray
    usable: list[np.ndarray]


def _signals(model: RobotModel, signals: Signals, rollouts: Sequence[Rollout]) -> Iterator[_Signal]:
    recordings = signals.recordings
    pairs = list(zip(recordings, rollouts, strict=True))
    usable, units = signals.usable, (signals.unit,) * model.n if signals.by_effort else model.units
    errors: list[np.ndarray | None] = [*measured_less_simulated(signals, rollouts)]
    yield _Signal("effort" if signals.by_effort else "position", units, errors, signals.sigma, usable)
    if signals.by_effort:
        return
    if any(r.velocity is not None for r in recordings):
        units = tuple(f"{u}/s" for u in model.units)
        errors = [None if r.velocity is None else r.velocity - run.velocity for r, run in pairs]
        yield _Signal("velocity", units, errors, _sensor_sds(recordings, "velocity"), usable)
    if any(r.effort is not None for r in recordings):
        scale = effort_scale(recordings, rollouts)
        errors = [None if r.effort is None else r.effort - scale * run.torque for r, run in pairs]
        yield _Signal("effort", ("effort",) * model.n, errors, _sensor_sds(recordings, "effort"), usable)
    servo = fit_servo(model, recordings, rollouts)
    if servo is not None:
        yield _Signal("servo", ("effort",) * model.n, servo.residuals, np.sqrt(servo.variance), servo.usable)


def _sensor_sds(recordings: Sequence[Recording], signal: str) -> np.ndarray:
    """Standard deviation (n,) of a signal's sensor noise, at least 1e-5 of the signal's range."""
    pairs = [(r, getattr(r, signal)) for r in recordings if getattr(r, signal) is not None]
    least = 1e-5 * np.max([np.ptp(x, axis=0) for _, x in pairs], axis=0)
    return np.maximum(noise_floor([sensor_sd(r.time, x) for r, x in pairs]), least)


def _rows(label: str, model: RobotModel, signal: _Signal, masks: Sequence[dict[str, np.ndarray]]) -> Iterator[Row]:
    for regime in ("all", *REGIMES):
        kept = [u if regime == "all" else u & mask[regime] for u, mask in zip(signal.usable, masks, strict=True)]
        squares, count = _sums(signal.errors, kept)
        for j in np.flatnonzero(count):
            mean, sigma = float(squares[j] / count[j]), float(signal.sigma[j])
            place = (label, signal.name, model.joints[j], regime, signal.units[j])
            yield Row(*place, rms=float(np.sqrt(mean)), noise=sigma, chi2=mean / sigma**2, samples=int(count[j]))


def _sums(errors: Sequence[np.ndarray | None], kept: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares (n,) and number of samples (n,) of errors (T, n) where `kept` (T, n) is true."""
    squares, count = np.zeros(kept[0].shape[1]), np.zeros(kept[0].shape[1], int)
    for error, keep in zip(errors, kept, strict=True):
        if error is not None:
            squares += (np.where(keep, error, 0.0) ** 2).sum(axis=0)
            count += keep.sum(axis=0)
    return squares, count


def _labels(models: Sequence[RobotModel]) -> tuple[str, ...]:
    """Labels of the models: their names; if models share a name, also the effects that the first of them lacks."""
    models = [m.with_(effects=tuple(e for e in m.effects if e.name not in NUISANCES)) for m in models]
    names = [m.name for m in models]
    labels: list[str] = []
    for i, model in enumerate(models):
        label = model.name
        first = names.index(model.name)
        if i != first:
            old = {e.name for e in models[first].effects}
            label = " + ".join([label, *(e.name for e in model.effects if e.name not in old)])
        again = (f"{label} ({k})" for k in range(2, len(models) + 2))
        labels.append(label if label not in labels else next(k for k in again if k not in labels))
    return tuple(labels)
