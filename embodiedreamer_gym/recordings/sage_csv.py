"""SAGE logs: a folder with control.csv, state_motor.csv and joint_list.txt.

Columns `type,timestamp,positions[,velocities,torques]`: timestamps in microseconds, each of the others a JSON
list in the order of joint_list.txt, positions in rad. Source: github.com/isaac-sim2real/sage.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.csv_text import (
    MAX_COLUMNS,
    NO_NUMBER,
    check_header,
    json_numbers,
    line_end_notes,
    lines_of,
    open_text,
    table,
)
from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.time_axis import find_clock

CONTROL, STATE, JOINTS = "control.csv", "state_motor.csv", "joint_list.txt"
Signals = dict[str, np.ndarray]


def is_sage_folder(path: str | Path) -> bool:
    """Whether a folder holds a SAGE log."""
    return (Path(path) / STATE).is_file() or (Path(path) / CONTROL).is_file()


def read_sage_csv(folder: str | Path, command_hold: str = "unknown", time_unit: str | None = None) -> Recording:
    """Read a SAGE folder as a recording at the times of its states.

    Each state gets the latest command before it, or an interpolated one for command_hold "linear". time_unit: unit of
    the timestamps, if it is not microseconds and cannot be inferred.

    Raises: RecordingError where a file is missing, too large or not of this form.
    """
    folder = Path(folder)
    for name in (STATE, CONTROL, JOINTS):
        if not (folder / name).is_file():
            raise RecordingError(f"{folder}: a SAGE log needs {name}, which is missing")
    with open_text(folder / JOINTS) as file:
        joints = tuple(line.strip() for line in lines_of(file, folder / JOINTS) if line.strip())
    if not 0 < len(joints) <= MAX_COLUMNS:
        raise RecordingError(f"{folder / JOINTS}: it names {len(joints)} joints; 1 to {MAX_COLUMNS} are read")
    stamps, state, notes = _read(folder / STATE, ("positions", "velocities", "torques"), len(joints))
    control_stamps, control, _ = _read(folder / CONTROL, ("positions",), len(joints))
    clock = find_clock(stamps, state["positions"], str(folder / STATE), time_unit, default="us")
    time, control_time = clock.seconds(stamps), clock.seconds(control_stamps)
    if control_time[-1] < time[0] or control_time[0] > time[-1]:
        raise RecordingError(
            f"{folder}: {CONTROL} and {STATE} do not overlap in time; they must use the same clock and unit"
        )
    return Recording(
        name=folder.resolve().name,
        joints=joints,
        time=time,
        position=state["positions"],
        command=resample(control_time, control["positions"], time, command_hold == "linear"),
        velocity=state.get("velocities"),
        effort=state.get("torques"),
        command_hold=command_hold,
        source=str(folder),
        notes=notes + clock.notes,
    )


def _read(path: Path, columns: tuple[str, ...], count: int) -> tuple[np.ndarray, Signals, tuple[str, ...]]:
    """Time stamps (T,), signals (T, n) and notes; all but the first column are left out where missing or zero."""
    with open_text(path) as file:
        rows = csv.reader(lines_of(file, path))
        header = next(rows, [])
        missing = [name for name in ("timestamp", columns[0]) if name not in header]
        if missing:
            raise RecordingError(f"{path}: no column {missing[0]} in the header {','.join(header)[:60]!r}")
        check_header(header, path)
        present = [name for name in columns if name in header]

        def parse(row: list[str], line: int) -> list[float]:
            cells = dict(zip(header, row, strict=False))
            try:
                values = [float(cells.get("timestamp", ""))]
            except ValueError as error:
                raise RecordingError(f"{path}: line {line} has no time in microseconds") from error
            for name in present:
                values += _numbers(cells.get(name), count, path, name, line)
            return values

        values = table(rows, 2, 1 + count * len(present), path, parse)
        notes = line_end_notes(file)
    late = np.flatnonzero(~(np.diff(values[:, 0], prepend=-np.inf) > 0))  # also catches NaN
    if late.size:
        raise RecordingError(f"{path}: time is not finite, repeats or runs backwards at row {late[0]} (counted from 0)")
    signals = {name: values[:, 1 + count * i : 1 + count * (i + 1)] for i, name in enumerate(present)}
    return values[:, 0], {name: x for name, x in signals.items() if name == columns[0] or np.any(x)}, notes


def _numbers(text: str | None, count: int, path: Path, name: str, line: int) -> list[float]:
    try:
        values = json_numbers(text)
    except NO_NUMBER as error:
        raise RecordingError(f"{path}: {name} on line {line} is not a list of numbers") from error
    if len(values) != count:
        raise RecordingError(f"{path}: {len(values)} {name} on line {line} for {count} joints of {JOINTS}")
    return values


def resample(time: np.ndarray, command: np.ndarray, at: np.ndarray, linear: bool) -> np.ndarray:
    """Command (T, n) at the times `at`: interpolated if linear, else the latest one before (or the first one)."""
    if time.shape == at.shape and np.array_equal(time, at):
        return command
    if linear:
        return np.column_stack([np.interp(at, time, column) for column in command.T])
    return command[np.clip(np.searchsorted(time, at, side="right") - 1, 0, None)]
