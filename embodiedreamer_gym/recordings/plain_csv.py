"""Plain CSV logs, one row a sample.

Header: `time,<joint>.command,<joint>.position[,<joint>.velocity,<joint>.effort]`; `<joint>.current` in place of
`<joint>.effort` is a motor's current in A, and a log of position and effort may lack the command. Comment lines
before it may say more, as `# name: value`: `command_hold: linear`, `units: rad` (one for all, or a JSON list), `kind:
step`, `effort_unit: N m` (or `A`), `noise: [..]`, `quantum: [..]`. The column `<joint>.usable` (0 or 1) is optional too.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.recording import Recording

_SIGNALS = ("command", "position", "velocity", "effort", "usable", "current")
_FORM = "time,<joint>.command,<joint>.position[,<joint>.velocity,<joint>.effort]"


def read_plain_csv(path: str | Path) -> Recording:
    """Recording of a plain CSV file; a velocity or effort that some joints lack is left out for all.

    Raises: RecordingError where the file is missing or not of this form.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: it is not text; a CSV file with the header {_FORM} is expected") from error
    notes, start = _notes(lines)
    header, rows = _header(lines, start, path)
    table = _table(rows, header, path, start)
    joints = tuple(dict.fromkeys(column.rpartition(".")[0] for column in header[1:]))
    signals = {signal: _columns(table, header, joints, signal, path) for signal in _SIGNALS}
    if signals["position"] is None:
        raise RecordingError(f"{path}: there is no column <joint>.position; the header must be {_FORM}")
    optional: dict[str, Any] = {name: notes[name] for name in ("command_hold", "kind", "effort_unit") if name in notes}
    optional |= {name: _numbers(notes[name], name, path) for name in ("noise", "quantum") if name in notes}
    usable, current = signals.pop("usable"), signals.pop("current")
    if current is not None and signals["effort"] is None:
        signals["effort"] = current
        optional.setdefault("effort_unit", "A")
    if usable is not None:
        optional["usable"] = usable != 0
    return Recording(
        name=path.stem,
        joints=joints,
        time=table[:, 0],
        units=_units(notes.get("units", ""), len(joints), path),
        source=str(path),
        **signals,  # pyright: ignore[reportArgumentType]
        **optional,
    )


def _notes(lines: list[str]) -> tuple[dict[str, str], int]:
    """Comment lines `# name: value` at the head, and where the header is."""
    notes: dict[str, str] = {}
    start = 0
    while start < len(lines) and (not lines[start].strip() or lines[start].lstrip().startswith("#")):
        name, _, value = lines[start].lstrip("# ").partition(":")
        notes[name.strip()] = value.strip()
        start += 1
    return notes, start


def _header(lines: list[str], start: int, path: Path) -> tuple[list[str], Iterator[list[str]]]:
    rows = csv.reader(lines[start:])
    header = [column.strip() for column in next(rows, [])]
    if not header:
        raise RecordingError(f"{path}: the file is empty; it must begin with the header {_FORM}")
    wrong = [c for c in header[1:] if c.rpartition(".")[2] not in _SIGNALS or not c.rpartition(".")[0]]
    if header[0] != "time" or wrong or len(header) < 2:
        odd = f"the column {wrong[0]!r}" if wrong else f"{','.join(header)[:60]!r}"
        hint = "; a SAGE log is read by giving its folder" if "timestamp" in header else ""
        raise RecordingError(f"{path}: {odd} does not fit the header {_FORM}{hint}")
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise RecordingError(f"{path}: the column {twice[0]} occurs more than once; joint names must differ")
    return header, rows


def _table(rows: Iterator[list[str]], header: list[str], path: Path, start: int) -> np.ndarray:
    values: list[list[float]] = []
    for number, row in enumerate(rows, start + 2):
        if not row:
            continue
        if len(row) != len(header):
            raise RecordingError(f"{path}: line {number} has {len(row)} values for {len(header)} columns")
        try:
            values.append([float(value) for value in row])
        except ValueError as error:
            raise RecordingError(f"{path}: line {number} holds something that is not a number") from error
    if not values:
        raise RecordingError(f"{path}: there is no row below the header")
    return np.array(values)


def _columns(
    table: np.ndarray, header: list[str], joints: tuple[str, ...], signal: str, path: Path
) -> np.ndarray | None:
    """Signal (T, n) of all joints, or None where not every joint has it."""
    have = [joint for joint in joints if f"{joint}.{signal}" in header]
    if signal in ("position", "command") and have and len(have) < len(joints):
        lack = next(joint for joint in joints if joint not in have)
        raise RecordingError(f"{path}: joint {lack} has no column {lack}.{signal}, but {have[0]} has one")
    if len(have) < len(joints):
        return None
    array = table[:, [header.index(f"{joint}.{signal}") for joint in joints]]
    return array if signal not in ("velocity", "effort", "current") or np.any(array) else None


def _numbers(text: str, name: str, path: Path) -> np.ndarray:
    try:
        return np.array(json.loads(text), dtype=float)
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{path}: `# {name}: {text}` is not a JSON list of numbers") from error


def _units(text: str, count: int, path: Path) -> tuple[str, ...]:
    if not text.startswith("["):
        return (text,) * count if text else ()
    try:
        return tuple(str(unit) for unit in json.loads(text))
    except ValueError as error:
        raise RecordingError(f"{path}: `# units: {text}` is neither a unit nor a JSON list of units") from error


def write_plain_csv(recording: Recording, path: str | Path) -> None:
    """Write a recording as plain CSV, without its frames, in full precision: it reads back equal."""
    signals = [s for s in _SIGNALS[:4] if getattr(recording, s) is not None]
    signals += [] if recording.usable.all() else ["usable"]
    notes = {
        "command_hold": recording.command_hold,
        "kind": recording.kind,
        "effort_unit": recording.effort_unit,
        "units": json.dumps(recording.units),
    }
    notes |= {
        "noise": json.dumps(recording.noise.tolist()),
        "quantum": json.dumps(recording.quantum.tolist()),
    }
    table = [recording.time.tolist()]
    for column in range(len(recording.joints)):
        for signal in signals:
            values = getattr(recording, signal)[:, column]
            table.append(values.astype(int).tolist() if signal == "usable" else values.tolist())
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        file.writelines(f"# {name}: {value}\n" for name, value in notes.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *(f"{joint}.{signal}" for joint in recording.joints for signal in signals)])
        writer.writerows(zip(*table, strict=True))
