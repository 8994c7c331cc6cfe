"""sessions: which parameters of a robot differ between days, loads or robots, and by how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy  # loads its submodules when they are used

from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.io.tables import layout, number
from embodiedreamer_gym.phys_aligner import Calibration, calibrate
from embodiedreamer_gym.phys_aligner.intervals import NORMAL_95
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterRow, RobotModel

FALSE_ALARMS = 0.05  # probability that any parameter of equal sessions is reported as different


@dataclass(frozen=True)
class Difference:
    """One parameter in a session, compared with the first session.

    first, value: the parameter in the first session and in this one, in `unit`.
    low, high: 95 % interval of value - first; None if a session does not determine the parameter.
    differs: whether it differs, with a 5 % probability of a false alarm over all parameters and sessions together.
    """

    session: str
    parameter: str
    first: float
    value: float
    low: float | None
    high: float | None
    unit: str
    differs: bool


@dataclass(frozen=True, eq=False)
class SessionComparison:
    """Calibrations of several sessions, and the differences to the first one."""

    calibrations: Mapping[str, Calibration]
    differences: tuple[Difference, ...]

    def __str__(self) -> str:
        first, *others = self.calibrations
        lines = []
        for session in others:
            own = [d for d in self.differences if d.session == session]
            rows = [
                (d.parameter, number(d.first), number(d.value), number(d.value - d.first), _interval(d), d.unit)
                for d in own
                if d.differs
            ]
            lines.append(f"{session} differs from {first} in {len(rows)} of {len(own)} parameters")
            if rows:
                lines.append(layout(("parameter", first, session, "difference", "95 % interval", "unit"), rows))
            unknown = [d.parameter for d in own if d.low is None]
            if unknown:
                lines.append(f"not determined in both: {', '.join(unknown)}")
            lines.append("")
        return "\n".join(lines).rstrip()

    def as_dict(self) -> dict[str, Any]:
        """The comparison as JSON, with units."""
        return {
            "sessions": {name: fit.as_dict() for name, fit in self.calibrations.items()},
            "differences": [asdict(d) for d in self.differences],
        }


def compare_sessions(
    model: RobotModel, sessions: Mapping[str, Sequence[Recording]], progress: ProgressCallback | None = None
) -> SessionComparison:
    """Calibrate a model to each session and compare its parameters with those of the first.

    Parameters of the robot, which do not depend on the session, are taken from the first one: errors of the URDF's
    masses, and the scale of an effort that is not in N m. An interval of a difference combines those of its two values
    (Zou and Donner, Statistics in Medicine 27, 2008); a value on a bound gets the other value's width.

    sessions: name -> recordings; the first one is the reference.
    Raises: CalibrationError for fewer than two sessions, or for recordings that the model does not fit.
    """
    if len(sessions) < 2:
        raise CalibrationError("give at least two sessions to compare.")
    progress = progress_or_silence(progress)
    calibrations: dict[str, Calibration] = {}
    for k, (name, recordings) in enumerate(sessions.items()):
        progress("calibrating sessions", k, len(sessions), session=name)
        calibrations[name] = calibrate(model, recordings, progress=progress)
        if k == 0:
            model = _of_the_robot(calibrations[name].model)
    first, *others = calibrations
    pairs = [(name, *rows) for name in others for rows in _fitted(calibrations[first], calibrations[name])]
    alarm = float(scipy.stats.norm.isf(FALSE_ALARMS / 2 / max(len(pairs), 1))) / NORMAL_95
    return SessionComparison(calibrations, tuple(_difference(*pair, alarm) for pair in pairs))


def _of_the_robot(model: RobotModel) -> RobotModel:
    """The model for further sessions, with the parameters of the robot held fixed."""
    scaled = any(isinstance(effect, EffortSensor) and effect.values["scale"] for effect in model.effects)
    return model.with_fixed("urdf", *([f"{EffortSensor.name}.scale"] if scaled else []))


def _fitted(first: Calibration, other: Calibration) -> list[tuple[ParameterRow, ParameterRow]]:
    """Rows of the parameters that both calibrations have fitted."""
    keys = [{row.key for row in fit.problem.rows} if fit.problem else set() for fit in (first, other)]
    olds, news = ({row.key: row for row in fit.model.parameters()} for fit in (first, other))
    return [(olds[key], news[key]) for key in olds if key in keys[0] & keys[1]]


def _difference(session: str, first: ParameterRow, row: ParameterRow, alarm: float) -> Difference:
    """Compare two rows; alarm: half-width of the interval that decides, relative to that of a 95 % interval."""
    below, above = _widths(row, first)
    first_below, first_above = _widths(first, row)
    down, up = np.hypot(below, first_above), np.hypot(above, first_below)
    change = row.value - first.value
    known = bool(np.isfinite(down) and np.isfinite(up))
    low, high = (float(change - down), float(change + up)) if known else (None, None)
    differs = known and not change - alarm * down <= 0 <= change + alarm * up
    return Difference(session, row.name, first.value, row.value, low, high, row.unit, differs)


def _widths(row: ParameterRow, other: ParameterRow) -> tuple[float, float]:
    """Distances from a value to the ends of its interval; for a value on a bound, those of the other value."""
    on_bound = min(row.value - row.low, row.high - row.value) <= 1e-9 * (row.high - row.low)
    source = other if row.interval is None and on_bound else row
    if source.interval is None:
        return np.inf, np.inf
    return source.value - source.interval[0], source.interval[1] - source.value


def _interval(difference: Difference) -> str:
    if difference.low is None or difference.high is None:
        return "-"
    return f"[{number(difference.low)}, {number(difference.high)}]"
