"""Find the unit of a log's time stamps from what the log states, the stamps and the motion; if unclear, ask the user.

Stamps may be seconds, milliseconds, microseconds or nanoseconds, from any origin or since 1970. A unit is inferred only
if it is the only one with a control rate between 1 Hz and 10 kHz and with speeds that a joint can reach.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
PLAUSIBLE_HZ = (0.98, 10_200.0)  # of a log whose unit is inferred: 1 Hz to 10 kHz
SLOWEST_HZ = 0.1  # of a log in the unit documented by its format
ALLOWED_HZ = (1e-3, 1e6)  # range of a stated rate
SINCE_1970 = (9e8, 4.2e9)  # s; the years 1998 to 2103
SPEEDS = (0.02, 50.0)  # rad/s, m/s or 1/s that the fastest joint of a log may reach
MOVES = 0.05  # rad, m or 1: a joint that moves less is not used to infer the unit


def check_unit(unit: str | None) -> None:
    """Raises: RecordingError for an unknown time unit; None means that none is given."""
    if unit is not None and unit not in TIME_UNITS:
        raise RecordingError(f"time_unit {unit!r} is not one of {', '.join(TIME_UNITS)}")


def check_hz(hz: Any, source: str) -> float:
    """A stated sampling rate as a float, Hz; source: file, for the message.

    Raises: RecordingError where it is not a number from 0.001 Hz to 1 MHz.
    """
    try:
        value = float(hz)
    except (TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"{source}: the rate is not a number") from error
    if not ALLOWED_HZ[0] <= value <= ALLOWED_HZ[1]:
        raise RecordingError(f"{source}: the rate is {value:g} Hz; it must be above 0, from 0.001 to 1e6")
    return value


def parse_unit(label: str) -> str | None:
    """The time unit that a label names, such as "ms", "microseconds" or "µs"; None for another label."""
    label = label.strip().lower().replace("µ", "u").replace("μ", "u")
    singular = {**{name.rstrip("s"): unit for unit, name in NAMES.items()}, "sec": "s", "msec": "ms", "usec": "us", "nsec": "ns"}  # fmt: skip
    return label if label in TIME_UNITS else singular.get(label.rstrip("s"))


def column_unit(column: str) -> tuple[bool, str | None]:
    """Whether a column is the time, and the unit that its name states: `time`, `time_ms`, `time [ms]`, `time(ns)`."""
    match = re.fullmatch(r"(?:time|timestamp)(?:[ _]?[\[(]?([^\W_]+)[\])]?)?", column.strip(), re.IGNORECASE)
    unit = parse_unit(match[1]) if match and match[1] else None
    return match is not None and (match[1] is None or unit is not None), unit


@dataclass(frozen=True)
class Clock:
    """Unit of time stamps, the stamp that counts as 0 s (None: 0), and notes on the conversion."""

    unit: str
    origin: Any = None
    notes: tuple[str, ...] = ()

    def seconds(self, stamps: np.ndarray) -> np.ndarray:
        """Times (T,) in s of stamps (T,)."""
        raw = np.asarray(stamps if self.origin is None else stamps - self.origin, dtype=float)
        return raw if self.unit == "s" else raw * TIME_UNITS[self.unit]


def find_clock(
    stamps: np.ndarray, position: np.ndarray, source: str, unit: str | None = None, stated: str | None = None,
    default: str = "s",
) -> Clock:  # fmt: skip
    """Find the unit of time stamps; stamps since 1970 are counted from the first one.

    stamps: (T,) numbers; position: (T, n), whose speeds help to infer the unit; source: file, for messages; unit: given
    by the user; stated: stated by the log, such as "ms"; default: unit documented by the format, also used for stamps
    that are not finite or do not increase (Recording reports their row).
    Raises: RecordingError that asks for the unit where none, or more than one, is plausible.
    """
    check_unit(unit)
    raw = np.asarray(stamps, dtype=float)
    if raw.size < 2 or not np.isfinite(raw).all() or (np.diff(raw) <= 0).any():
        return Clock(unit or default)
    step = float(np.median(np.diff(raw)))
    named = parse_unit(stated) if stated else None
    chosen = unit or named or _infer(raw, step, position, source, default)
    first = float(raw[0]) * TIME_UNITS[chosen]
    if SINCE_1970[0] <= first <= SINCE_1970[1]:
        date = f"{NAMES[chosen]} since 1970 ({datetime.fromtimestamp(first, UTC):%Y-%m-%d %H:%M:%S} UTC)"
        note = f"the times are {date}; they are counted from the first sample"
        return Clock(chosen, np.asarray(stamps)[0], (note,))
    if chosen == default:
        return Clock(chosen)
    reason = "as given" if unit else "as the log states" if named else f"a step of {step:g} is {1 / (step * TIME_UNITS[chosen]):.4g} Hz"  # fmt: skip
    return Clock(chosen, None, (f"the times are {NAMES[chosen]} ({reason}) and were converted to seconds",))


def _infer(raw: np.ndarray, step: float, position: np.ndarray, source: str, default: str) -> str:
    """The only plausible unit.

    Raises: RecordingError that asks for the unit where none, or more than one, is plausible.
    """
    hz = {unit: 1 / (step * scale) for unit, scale in TIME_UNITS.items()}
    plausible = [unit for unit in hz if PLAUSIBLE_HZ[0] <= hz[unit] <= PLAUSIBLE_HZ[1]]
    epoch = [unit for unit in plausible if SINCE_1970[0] <= raw[0] * TIME_UNITS[unit] <= SINCE_1970[1]]
    if len(epoch) == 1:
        return epoch[0]
    if SLOWEST_HZ <= hz[default] < PLAUSIBLE_HZ[0]:
        plausible.append(default)
    if len(plausible) > 1:
        moves = [unit for unit in plausible if _is_motion(raw * TIME_UNITS[unit], position)]
        plausible = moves if len(moves) == 1 else plausible
    if len(plausible) == 1:
        return plausible[0]
    if plausible:
        rates = " or ".join(f"{hz[unit]:.4g} Hz in {unit}" for unit in plausible)
        raise RecordingError(
            f"{source}: the unit of these times may be {' or '.join(NAMES[unit] for unit in plausible)}: their step of {step:g} is {rates}, "
            f"and the motion fits both; give --time-unit {plausible[0]} or {plausible[-1]} (time_unit=...)"
        )
    raise RecordingError(
        f"{source}: the unit of these times is not known: their step of {step:g} does not give a rate between 1 Hz "
        "and 10 kHz in s, ms, us or ns; give the unit, for example --time-unit ms (time_unit=...), or correct the "
        "stamps"
    )


def _is_motion(time: np.ndarray, position: np.ndarray) -> bool:
    """Whether the fastest joint has a plausible speed, by the 99th percentile."""
    if position.ndim != 2 or len(position) != len(time) or not np.isfinite(position).all():
        return False
    moving = np.asarray(position, float)[:, np.ptp(position, axis=0) > MOVES]
    speed = np.abs(np.diff(moving, axis=0)) / np.diff(time)[:, None]
    return bool(speed.size and SPEEDS[0] <= np.percentile(speed, 99, axis=0).max() <= SPEEDS[1])
