"""SAGE logs: a folder with control.csv, state_motor.csv and joint_list.txt.

Columns `type,timestamp,positions[,velocities,torques]`: timestamps in microseconds, each of the others a JSON
list in the order of joint_list.txt, positions in rad. Source: github.com/isaac-sim2real/sage.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.recording import Recording

CONTROL, STATE, JOINTS = "control.csv", "state_motor.csv", "joint_list.txt"


def is_sage_folder(path: str | Path) -> bool:
    """Whether a folder holds a SAGE log."""
    return (Path(path) / STATE).is_file() or (Path(path) / CONTROL).is_file()


def read_sage_csv(folder: str | Path, command_hold: str = "unknown") -> Recording:
    """Recording of a SAGE folder at the times of its states.

    Commands at other times are held from the latest one before, or interpolated for command_hold "linear".

    Raises: RecordingError where a file is missing or not of this form.
    """
    folder = Path(folder)
    for name in (STATE, CONTROL, JOINTS):
        if not (folder / name).is_file():
            raise RecordingError(f"{folder}: a SAGE log needs {name}, which is missing")
    joints = tuple(line.strip() for line in (folder / JOINTS).read_text(encoding="utf-8").splitlines() if line.strip())
    state_time, state = _read(folder / STATE, ("positions", "velocities", "torques"), len(joints))
    control_time, control = _read(folder / CONTROL, ("positions",), len(joints))
    command = _aligned(control_time, control["positions"], state_time, command_hold == "linear")
    return Recording(
        name=folder.resolve().name,
        joints=joints,
        time=state_time,
        position=state["positions"],
        command=command,
        velocity=state.get("velocities"),
        effort=state.get("torques"),
        command_hold=command_hold,
        source=str(folder),
    )


def _read(path: Path, columns: tuple[str, ...], count: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (T,) s and signals (T, n); all but the first column are left out where absent or zero."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        have = reader.fieldnames or []
        missing = [name for name in ("timestamp", columns[0]) if name not in have]
        if missing:
            raise RecordingError(f"{path}: no column {missing[0]} in the header {','.join(have)!r}")
        rows = list(reader)
    if not rows:
        raise RecordingError(f"{path}: there is no row below the header")
    time = np.array([_seconds(row["timestamp"], path, number) for number, row in enumerate(rows, 2)])
    late = np.flatnonzero(~(np.diff(time, prepend=-np.inf) > 0))  # a NaN is not greater either
    if late.size:
        raise RecordingError(f"{path}: time is not finite, repeats or runs backwards at row {late[0]} (counted from 0)")
    signals = {
        name: np.array([_numbers(row[name], count, path, name, number) for number, row in enumerate(rows, 2)])
        for name in columns
        if name in have
    }
    return time, {name: x for name, x in signals.items() if name == columns[0] or np.any(x)}


def _seconds(text: str | None, path: Path, number: int) -> float:
    try:
        return float(text or "") * 1e-6
    except ValueError as error:
        raise RecordingError(f"{path}: line {number} has no time in microseconds") from error


def _numbers(text: str | None, count: int, path: Path, name: str, number: int) -> list[float]:
    try:
        values = [float(value) for value in json.loads(text or "")]
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{path}: {name} on line {number} is not a list of numbers") from error
    if len(values) != count:
        raise RecordingError(f"{path}: {len(values)} {name} on line {number} for {count} joints of {JOINTS}")
    return values


def _aligned(time: np.ndarray, command: np.ndarray, at: np.ndarray, linear: bool) -> np.ndarray:
    """Command (T, n) at other times: linear, or the latest before; the first one before that."""
    if time.shape == at.shape and np.array_equal(time, at):
        return command
    if linear:
        return np.column_stack([np.interp(at, time, column) for column in command.T])
    return command[np.clip(np.searchsorted(time, at, side="right") - 1, 0, None)]
