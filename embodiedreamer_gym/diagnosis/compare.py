"""compare: what models do when they hear the recordings' commands, against what was measured.

Where no log holds a command, the effort that a model needs for the measured motion is compared instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from embodiedreamer_gym.diagnosis.regimes import REGIMES, regimes
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.geometry.pose_error import EndEffector, rotation_error, translation_error
from embodiedreamer_gym.io.tables import MILLI, finite, layout, number
from embodiedreamer_gym.phys_aligner.signals import Signals, effort_scales, with_effort_unit
from embodiedreamer_gym.recordings import Recording, noise_floor, sensor_sd
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Rollout

DIVERGED = 900.0  # rad/s; the simulation clips a little above


@dataclass(frozen=True)
class Row:
    """Error of one model in one signal, joint and regime ("all" is every usable sample).

    rms and noise in `unit`; chi2: mean square of the error in units of the noise; samples: how many.
    """

    model: str
    signal: str
    joint: str
    regime: str
    unit: str
    rms: float
    noise: float
    chi2: float
    samples: int


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """How far models are from recordings; arrays have one row per model, in the order they were given.

    labels: names of the models, each different; signal: what is compared, "position", or "effort" of logs without a
    command; error (models,): mean over joints of each joint's root mean square over all usable samples, in `unit`, rad
    (or the joint's own), N m or A; noise: mean over joints of the sensor's sd;
    joint_rms, joint_chi2 (models, n), nan where a joint has no usable sample; joint_noise (n,);
    trajectory (models, 2): the paper's losses, translation error in m and rotation error in rad, averaged
    over time and arms; end_effector_mm (models,): the former in mm; diverged (models,) bool;
    signals: what was compared; table: one Row per model, signal, joint and regime; rollouts: [model][recording], arrays (T, n).
    """

    labels: tuple[str, ...]
    models: tuple[RobotModel, ...]
    recordings: tuple[Recording, ...]
    rollouts: tuple[tuple[Rollout, ...], ...]
    error: np.ndarray
    noise: float
    joint_rms: np.ndarray
    joint_chi2: np.ndarray
    joint_noise: np.ndarray
    end_effector_mm: np.ndarray
    trajectory: np.ndarray
    diverged: np.ndarray
    signals: Signals
    table: tuple[Row, ...] = field(default=())

    @property
    def signal(self) -> str:
        """What is compared."""
        return "effort" if self.signals.by_effort else "position"

    @property
    def unit(self) -> str:
        """Unit of the error."""
        return self.signals.unit or "rad"

    def __repr__(self) -> str:
        sizes = f"{len(self.labels)} models, {len(self.recordings)} recordings, n={len(self.joint_noise)}"
        return f"Comparison({sizes})"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.models[0].joints

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's compared signal."""
        return self.models[0].units if self.signal == "position" else (self.unit,) * len(self.joints)

    def errors(self, model: int = -1) -> list[np.ndarray]:
        """Measured less simulated (T, n) of one model, per recording, in the compared signal."""
        return [e[0] for e in self.signals.errors(_sets_of(self.rollouts[model]))]

    def rows(self, model: int = -1, signal: str = "", regime: str | None = None) -> list[Row]:
        """The table's rows of one model and signal, of all regimes or of one."""
        wanted = (self.labels[model], signal or self.signal)
        return [r for r in self.table if (r.model, r.signal) == wanted and regime in (None, r.regime)]

    def grid(self, model: int = -1, value: str = "chi2", signal: str = "") -> np.ndarray:
        """Values (n, 7) of one model by joint and regime, "all" first, nan where there is no sample."""
        names = ("all", *REGIMES)
        result = np.full((len(self.joints), len(names)), np.nan)
        for row in self.rows(model, signal):
            result[self.joints.index(row.joint), names.index(row.regime)] = getattr(row, value)
        return result

    def as_dict(self) -> dict[str, Any]:
        """The comparison as JSON, with units."""
        error = dict(zip(self.labels, self.error.tolist(), strict=True))
        return {
            "recordings": [r.name for r in self.recordings],
            "models": list(self.labels),
            "signal": self.signal,
            "error": {"unit": self.unit, "noise": self.noise, "of": error},
            "end_effector_mm": {k: finite(v) for k, v in zip(self.labels, self.end_effector_mm, strict=True)},
            "trajectory": {
                k: {"translation_m": finite(m), "rotation_rad": finite(angle)}
                for k, (m, angle) in zip(self.labels, self.trajectory, strict=True)
            },
            "diverged": [k for k, bad in zip(self.labels, self.diverged, strict=True) if bad],
            "table": [{**vars(row)} for row in self.table],
        }

    def __str__(self) -> str:
        parts = [self._summary()]
        if len(self.labels) > 1:
            parts.append(self._joints())
        parts.append(self._regimes())
        parts += [
            self._other(signal)
            for signal in ("velocity", "effort")
            if signal != self.signal and self.rows(signal=signal)
        ]
        return "\n\n".join(parts)

    def _summary(self) -> str:
        seconds = sum(r.duration for r in self.recordings)
        rows = []
        for i, label in enumerate(self.labels):
            chi2 = number(float(np.nanmean(self.joint_chi2[i])))
            errors = [f"{number(1e3 * value)} {MILLI[self.unit]}" for value in (self.error[i], self.noise)]
            name = f"{label} (diverges)" if self.diverged[i] else label
            rows.append([name, *errors, chi2, f"{number(self.end_effector_mm[i])} mm"])
        title = f"{len(self.recordings)} recordings, {seconds:.1f} s, {len(self.joints)} joints"
        return title + "\n" + layout(["model", "error", "noise", "chi2/n", "end effector"], rows)

    def _joints(self) -> str:
        heads = [label if len(label) <= 20 else f"{label[:8]}…{label[-11:]}" for label in self.labels]
        rows = []
        for j, joint in enumerate(self.joints):
            errors = [number(1e3 * value) for value in (*self.joint_rms[:, j], self.joint_noise[j])]
            rows.append([joint, *errors, MILLI[self.units[j]]])
        return layout(["joint (rms)", *heads, "noise", "unit"], rows)

    def _regimes(self) -> str:
        rms, chi2 = self.grid(value="rms"), self.grid()
        rows = []
        for j, joint in enumerate(self.joints):
            errors = [number(1e3 * value) for value in (*rms[j], self.joint_noise[j])]
            rows.append([joint, *errors, number(chi2[j, 0]), MILLI[self.units[j]]])
        heads = ["all", "hold", "slow", "fast", "reversal", "accel.", "loaded", "noise", "chi2/n", "unit"]
        return f"{self.signal} error (rms) of {self.labels[-1]} by regime\n" + layout(["joint", *heads], rows)

    def _other(self, signal: str) -> str:
        found = self.rows(signal=signal, regime="all")
        rows = [[r.joint, number(r.rms), number(r.noise), number(r.chi2), r.unit] for r in found]
        note = ", the model's torque times a fitted scale" if signal == "effort" else ""
        title = f"{signal} error (rms) of {self.labels[-1]}{note}"
        return title + "\n" + layout(["joint", "rms", "noise", "chi2/n", "unit"], rows)


def compare(
    models: RobotModel | Sequence[RobotModel],
    recordings: Sequence[Recording],
    labels: Sequence[str] | None = None,
) -> Comparison:
    """Free-run every recording under each model and set the difference against the sensors' noise.

    labels: what to call the models, all different; default their names and the effects that tell them apart.
    Raises: SimulationError when a recording is not of this robot, RecordingError when nothing is to compare.
    """
    models = (models,) if isinstance(models, RobotModel) else tuple(models)
    recordings = tuple(recordings)
    if not models or not recordings:
        raise RecordingError("there is nothing to compare; give at least one model and one recording.")
    recordings = with_effort_unit(models[0], recordings)
    if not any(r.usable.any() for r in recordings):
        raise RecordingError("no usable sample is left to compare: all of it is contact or faulty.")
    rollouts = tuple(free_runs(model, recordings) for model in models)
    labels = _labels(models) if labels is None else tuple(labels)
    masks = [regimes(models[0], r) for r in recordings]
    signals = Signals(models[0], recordings)
    signal = "effort" if signals.by_effort else "position"
    table: list[Row] = []
    for label, model, runs in zip(labels, models, rollouts, strict=True):
        for one in _signals(model, signals, runs):
            table += _rows(label, model, one, masks)
    rms, chi2 = (np.full((len(models), models[0].n), np.nan) for _ in range(2))
    for row in table:
        if (row.signal, row.regime) == (signal, "all"):
            place = labels.index(row.model), models[0].joints.index(row.joint)
            rms[place], chi2[place] = row.rms, row.chi2
    noise = signals.sigma
    losses = [
        (np.nan, np.nan) if signals.by_effort else trajectory_losses(m, recordings, runs)
        for m, runs in zip(models, rollouts, strict=True)
    ]
    return Comparison(
        labels, models, recordings, rollouts,
        error=np.nanmean(rms, axis=1),
        noise=float(noise.mean()),
        joint_rms=rms,
        joint_chi2=chi2,
        joint_noise=noise,
        trajectory=np.array(losses),
        end_effector_mm=1e3 * np.array(losses)[:, 0],
        diverged=np.array([any(np.abs(run.velocity).max() > DIVERGED for run in runs) for runs in rollouts]),
        signals=signals,
        table=tuple(table),
    )  # fmt: skip


def free_runs(model: RobotModel, recordings: Sequence[Recording]) -> tuple[Rollout, ...]:
    """Free runs (inverse runs where no log holds a command) of recordings under one model; arrays (T, n)."""
    runs = Signals(model, recordings).runs(model)
    return tuple(Rollout(r.time, r.position[0], r.velocity[0], r.torque[0]) for r in runs)


def effort_scale(recordings: Sequence[Recording], rollouts: Sequence[Rollout]) -> np.ndarray:
    """Effort per model torque (n,), least squares through the origin over the usable samples."""
    logs = [(r.effort, run.torque[None], r.usable) for r, run in zip(recordings, rollouts, strict=True)
            if r.effort is not None]  # fmt: skip
    efforts, torques, usable = zip(*logs, strict=True)
    return effort_scales(efforts, torques, usable)[0, 0]


@dataclass(frozen=True, eq=False)
class _Signal:
    """One signal's errors (T, n) per recording, None where a recording lacks it, and its noise (n,)."""

    name: str
    units: tuple[str, ...]
    errors: list[np.ndarray | None]
    sigma: np.ndarray
    usable: list[np.ndarray]


def _sets_of(rollouts: Sequence[Rollout]) -> list[Rollout]:
    """Rollouts of one model as those of one parameter set, arrays (1, T, n)."""
    return [Rollout(r.time, r.position[None], r.velocity[None], r.torque[None]) for r in rollouts]


def _signals(model: RobotModel, signals: Signals, rollouts: Sequence[Rollout]) -> Iterator[_Signal]:
    recordings = signals.recordings
    pairs = list(zip(recordings, rollouts, strict=True))
    usable, units = signals.usable, (signals.unit,) * model.n if signals.by_effort else model.units
    errors: list[np.ndarray | None] = [e[0] for e in signals.errors(_sets_of(rollouts))]
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


def _sensor_sds(recordings: Sequence[Recording], signal: str) -> np.ndarray:
    """Sd (n,) of another signal's noise, at least a hundred-thousandth of the signal's range."""
    pairs = [(r, getattr(r, signal)) for r in recordings if getattr(r, signal) is not None]
    least = 1e-5 * np.max([np.ptp(x, axis=0) for _, x in pairs], axis=0)
    return np.maximum(noise_floor([sensor_sd(r.time, x) for r, x in pairs]), least)


def _rows(label: str, model: RobotModel, signal: _Signal, masks: Sequence[dict[str, np.ndarray]]) -> Iterator[Row]:
    for regime in ("all", *REGIMES):
        squares, count = np.zeros(model.n), np.zeros(model.n, int)
        for error, usable, mask in zip(signal.errors, signal.usable, masks, strict=True):
            if error is not None:
                keep = usable if regime == "all" else usable & mask[regime]
                squares += (np.where(keep, error, 0.0) ** 2).sum(axis=0)
                count += keep.sum(axis=0)
        for j in np.flatnonzero(count):
            mean, sigma = float(squares[j] / count[j]), float(signal.sigma[j])
            place = (label, signal.name, model.joints[j], regime, signal.units[j])
            yield Row(*place, rms=float(np.sqrt(mean)), noise=sigma, chi2=mean / sigma**2, samples=int(count[j]))


def trajectory_losses(
    model: RobotModel, recordings: Sequence[Recording], rollouts: Sequence[Rollout]
) -> tuple[float, float]:
    """Translation error, m, and rotation error, rad, means over time and arms; nan where none is usable."""
    totals, weight = np.zeros(2), 0
    for arm, link in enumerate(model.tree.tips):
        end = EndEffector(model.urdf, link)
        own = [j for j in range(model.n) if model.tree.arm[j] == model.tree.arm[_driver(model, arm)]]
        for recording, run in zip(recordings, rollouts, strict=True):
            keep = recording.usable[:, own].all(axis=1)
            if not keep.any():
                continue
            measured, simulated = (_poses(end, model, q[keep]) for q in (recording.position, run.position))
            errors = translation_error(simulated[0], measured[0]), rotation_error(simulated[1], measured[1])
            totals, weight = totals + keep.sum() * np.array(errors), weight + int(keep.sum())
    return tuple(totals / weight) if weight else (np.nan, np.nan)


def _driver(model: RobotModel, tip: int) -> int:
    """The driven joint nearest to an end effector."""
    body = list(model.tree.tips.values())[tip][0]
    return int(model.tree.coordinate[body])


def _poses(end: EndEffector, model: RobotModel, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a link at joint positions (T, n) in the model's units; joints not driven stay at zero."""
    values = position.copy()
    for joint, (zero, one) in model.normalised.items():
        column = model.joints.index(joint)
        values[:, column] = zero + position[:, column] * (one - zero)
    undriven = [j for j in end.joints if j not in model.tree.joint_names]
    return end.pose(np.hstack([values, np.zeros((len(values), len(undriven)))]), (*model.joints, *undriven))


def _labels(models: Sequence[RobotModel]) -> tuple[str, ...]:
    """Names of the models; what they add to the first of that name tells those apart that share one."""
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
