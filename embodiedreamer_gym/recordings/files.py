"""Load recordings from files, folders and globs; save one, by suffix."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.recordings.aloha_hdf5 import read_aloha_hdf5, write_aloha_hdf5
from embodiedreamer_gym.recordings.hdf5 import SUFFIXES as HDF5
from embodiedreamer_gym.recordings.plain_csv import read_plain_csv, write_plain_csv
from embodiedreamer_gym.recordings.recording import COMMAND_HOLDS, Recording, Recordings
from embodiedreamer_gym.recordings.sage_csv import is_sage_folder, read_sage_csv
from embodiedreamer_gym.recordings.time_axis import check_unit

CSV = ".csv"
ALLOWED = ".hdf5, .h5 or .csv, or a SAGE folder with control.csv and state_motor.csv"


@renamed_arguments(rate="hz")
def load_recordings(
    *patterns: str | os.PathLike[str],
    hz: float | None = None,
    joints: Iterable[str] | None = None,
    command_hold: str | None = None,
    time_unit: str | None = None,
    gains: Mapping[str, float] | None = None,
) -> Recordings:
    """Recordings of files, folders and globs, in natural order (step_2 before step_10), none twice.

    A folder is a SAGE log, or stands for every recording directly in it.

    hz: sampling rate, Hz, for files without times.
    joints: names for files that have none; of a file with names, the joints to take.
    command_hold: "linear" or "hold", where the log does not state it or states it wrongly.
    time_unit: "s", "ms", "us" or "ns", where the log does not state the unit of its times and does not show it.
    gains: pattern of a path's end ("fast_*", "high/*.csv") -> firmware gain, in place of what the log states; the last that
        fits counts.

    Raises: RecordingError where a pattern matches nothing or a file cannot be used.
    """
    if not patterns:
        raise RecordingError("no recording was named; give files, folders or globs such as logs/*.hdf5")
    if command_hold is not None and command_hold not in COMMAND_HOLDS:
        raise RecordingError(f"command_hold {command_hold!r} is not one of {', '.join(COMMAND_HOLDS)}")
    check_unit(time_unit)
    names = None if joints is None else tuple(joints)
    loaded = [_load(path, hz, names, command_hold, time_unit) for path in matching_files(*patterns)]
    return Recordings(with_gain(recording, gains or {}) for recording in loaded)


def matching_files(*patterns: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Files and SAGE folders that files, folders and globs stand for, none twice.

    Raises: RecordingError where a pattern matches nothing.
    """
    return tuple(dict.fromkeys(path for pattern in patterns for path in _matches(os.fspath(pattern))))


def with_gain(recording: Recording, gains: Mapping[str, float]) -> Recording:
    """The recording at the gain of the last pattern that fits the end of its path, else as it is."""
    fitting = [gain for pattern, gain in gains.items() if Path(recording.source).match(pattern)]
    return recording.with_(gain=fitting[-1]) if fitting else recording


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write a recording as .hdf5 (ALOHA layout) or .csv (without frames), whole or not at all.

    Raises: RecordingError for another suffix or a folder that cannot be written to.
    """
    target = Path(path)
    write = write_aloha_hdf5 if target.suffix in HDF5 else write_plain_csv
    if target.suffix not in (*HDF5, CSV):
        raise RecordingError(f"{target}: cannot write the suffix {target.suffix!r}; use .hdf5, .h5 or .csv")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror or error}.") from error
    with atomic_file(target, RecordingError, target.suffix) as part:
        write(recording, part)
    return target


def _matches(pattern: str) -> list[Path]:
    pattern = os.path.expanduser(pattern)
    path = Path(pattern)
    if path.exists():
        matches = [path]
    elif glob.has_magic(pattern):
        matches = [Path(name) for name in glob.glob(pattern, recursive=True)]
        if not matches:
            raise RecordingError(f"{pattern}: the pattern matches no file")
    else:
        raise RecordingError(f"{pattern}: there is no such file or folder")
    return [one for match in sorted(matches, key=natural) for one in _expanded(match)]


def natural(path: Path) -> list[tuple[int, str]]:
    """Sorting key under which step_2 comes before step_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def _expanded(path: Path) -> list[Path]:
    if not path.is_dir() or is_sage_folder(path):
        return [path]
    inside = [one for one in path.iterdir() if one.suffix in (*HDF5, CSV) or (one.is_dir() and is_sage_folder(one))]
    if not inside:
        raise RecordingError(f"{path}: there is no recording in this folder; expected {ALLOWED}")
    return sorted(inside, key=natural)


def _load(
    path: Path, hz: float | None, joints: tuple[str, ...] | None, command_hold: str | None, time_unit: str | None
) -> Recording:
    if path.is_dir():
        recording = read_sage_csv(path, command_hold or "unknown", time_unit)
    elif path.suffix in HDF5:
        recording = read_aloha_hdf5(path, hz, joints, time_unit)
    elif path.suffix == CSV:
        recording = read_plain_csv(path, time_unit)
    else:
        raise RecordingError(f"{path}: the suffix {path.suffix!r} is not known; expected {ALLOWED}")
    if joints is not None and recording.joints != joints:
        recording = recording.only(joints)
    return recording if command_hold in (None, recording.command_hold) else recording.with_(command_hold=command_hold)
