"""Load recordings from files, folders and globs; save one, by suffix."""

from __future__ import annotations

import glob
import os
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.aloha_hdf5 import read_aloha_hdf5, write_aloha_hdf5
from embodiedreamer_gym.recordings.plain_csv import read_plain_csv, write_plain_csv
from embodiedreamer_gym.recordings.recording import COMMAND_HOLDS, Recording, Recordings
from embodiedreamer_gym.recordings.sage_csv import is_sage_folder, read_sage_csv

_HDF5 = (".hdf5", ".h5")
_SUFFIXES = (*_HDF5, ".csv")
_ALLOWED = ".hdf5, .h5 or .csv, or a SAGE folder with control.csv and state_motor.csv"


def load_recordings(
    *patterns: str | os.PathLike[str],
    rate: float | None = None,
    joints: Iterable[str] | None = None,
    command_hold: str | None = None,
) -> Recordings:
    """Recordings of files, folders and globs, in natural order (step_2 before step_10), none twice.

    A folder is a SAGE log, or stands for every recording directly in it. rate: Hz, for files without times.
    joints: names for files that have none; of a file with names, the joints to take. command_hold: "linear"
    or "hold", where the log does not say it or says it wrongly.

    Raises: RecordingError where a pattern matches nothing or a file cannot be used.
    """
    if not patterns:
        raise RecordingError("no recording was named; give files, folders or globs such as logs/*.hdf5")
    if command_hold is not None and command_hold not in COMMAND_HOLDS:
        raise RecordingError(f"command_hold {command_hold!r} is not one of {', '.join(COMMAND_HOLDS)}")
    names = None if joints is None else tuple(joints)
    paths = dict.fromkeys(path for pattern in patterns for path in _matches(os.fspath(pattern)))
    return Recordings(_load(path, rate, names, command_hold) for path in paths)


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write a recording as .hdf5 (ALOHA layout) or .csv (without frames), beside it first, then renamed.

    Raises: RecordingError for another suffix or a folder that cannot be written to.
    """
    target = Path(path)
    write = write_aloha_hdf5 if target.suffix in _HDF5 else write_plain_csv
    if target.suffix not in _SUFFIXES:
        raise RecordingError(f"{target}: cannot write the suffix {target.suffix!r}; use .hdf5, .h5 or .csv")
    beside = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.stem}.", suffix=target.suffix)
        os.close(handle)
        os.chmod(beside, 0o666 & ~_umask())
        write(recording, beside)
        os.replace(beside, target)
    except OSError as error:
        raise RecordingError(f"{target}: cannot be written ({error.strerror or error})") from error
    finally:
        if beside is not None and os.path.exists(beside):
            os.unlink(beside)
    return target


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _matches(pattern: str) -> list[Path]:
    pattern = os.path.expanduser(pattern)
    path = Path(pattern)
    if path.exists():
        found = [path]
    elif glob.has_magic(pattern):
        found = [Path(name) for name in glob.glob(pattern, recursive=True)]
        if not found:
            raise RecordingError(f"{pattern}: the pattern matches no file")
    else:
        raise RecordingError(f"{pattern}: there is no such file or folder")
    return [one for match in sorted(found, key=natural) for one in _expanded(match)]


def natural(path: Path) -> list[tuple[int, str]]:
    """Sorting key under which step_2 comes before step_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def _expanded(path: Path) -> list[Path]:
    if not path.is_dir() or is_sage_folder(path):
        return [path]
    found = [one for one in path.iterdir() if one.suffix in _SUFFIXES or (one.is_dir() and is_sage_folder(one))]
    if not found:
        raise RecordingError(f"{path}: there is no recording in this folder; expected {_ALLOWED}")
    return sorted(found, key=natural)


def _load(path: Path, rate: float | None, joints: tuple[str, ...] | None, command_hold: str | None) -> Recording:
    if path.is_dir():
        recording = read_sage_csv(path, command_hold or "unknown")
    elif path.suffix in _HDF5:
        recording = read_aloha_hdf5(path, rate, joints)
    elif path.suffix == ".csv":
        recording = read_plain_csv(path)
    else:
        raise RecordingError(f"{path}: the suffix {path.suffix!r} is not known; expected {_ALLOWED}")
    if joints is not None and recording.joints != joints:
        recording = recording.only(joints)
    return recording if command_hold in (None, recording.command_hold) else recording.with_(command_hold=command_hold)
