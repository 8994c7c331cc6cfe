"""`meta/info.json` of a LeRobot set, checked: types, sizes, and paths that stay inside the folder."""

from __future__ import annotations

import re
import string
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from embodiedreamer_gym.errors import RecordingError, brief
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.recordings.episodes.episode_set import ACTION, STATE
from embodiedreamer_gym.recordings.frames import MAX_EDGE
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS
from embodiedreamer_gym.recordings.time_axis import ALLOWED_HZ

VERSION = "v3.0"
IMAGES = "observation.images."  # before the names of the cameras
FIELDS = ("chunk_index", "file_index", "video_key")
SPEC = re.compile(r"0?\d?d?")  # format of a number in a path; wider ones could fill the memory
MOST_COLUMNS = 4096
CONVERT = "python -m lerobot.scripts.convert_dataset_v21_to_v30"


@dataclass(frozen=True)
class Info:
    """hz: frames per second; counts of the set; cameras: name -> key, width and height; templates of its paths."""

    hz: float
    episodes: int
    frames: int
    state_size: int
    action_size: int
    cameras: dict[str, tuple[str, int, int]]
    data_path: str
    video_path: str


def read_info(folder: Path) -> Info:
    """Read meta/info.json of a set.

    Raises: RecordingError where it is missing, of another version, or holds impossible values.
    """
    path = folder / "meta" / "info.json"
    if not path.is_file():
        raise RecordingError(f"{folder}: meta/info.json is missing; a LeRobot set has it")
    data = read_json(path, RecordingError)
    data = data if isinstance(data, dict) else {}
    version = str(data.get("codebase_version"))
    if not version.startswith("v3."):
        raise RecordingError(
            f"{folder} is a LeRobot set of version {version}, but v3 is read; convert it with `{CONVERT}`"
        )
    features = data.get("features")
    if not isinstance(features, dict) or not all(isinstance(value, dict) for value in features.values()):
        raise RecordingError(f"{path}: features must be an object of objects")
    fps = data.get("fps")
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not ALLOWED_HZ[0] <= fps <= ALLOWED_HZ[1]:
        raise RecordingError(f"{path}: fps must be a number above 0, not {brief(fps)}")
    return Info(
        float(fps), _count(path, data, "total_episodes"), _count(path, data, "total_frames"),
        _width(path, features, STATE), _width(path, features, ACTION), _cameras(path, features),
        _template(path, data, "data_path"), _template(path, data, "video_path") if data.get("video_path") else "",
    )  # fmt: skip


def inside(folder: Path, template: str, chunk: int, file: int, key: str = "") -> Path:
    """Path of a file of the set.

    Raises: RecordingError where it would lie outside the set's folder.
    """
    text = template.format(chunk_index=chunk, file_index=file, video_key=key)
    parts = PurePosixPath(text)
    if parts.is_absolute() or ".." in parts.parts or "\\" in text or PureWindowsPath(text).drive:
        raise RecordingError(f"{folder}: meta/info.json names the file {text}, outside the set; it is not opened")
    return folder / parts


def _count(path: Path, data: dict[str, Any], key: str) -> int:
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MAX_NUMBERS:
        raise RecordingError(f"{path}: {key} must be a whole number of 1 to {MAX_NUMBERS}, not {brief(value)}")
    return value


def _shape(path: Path, key: str, feature: dict[str, Any], length: int) -> list[int]:
    shape = feature.get("shape")
    whole = isinstance(shape, list) and all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in shape)
    if not isinstance(shape, list) or not whole or len(shape) != length:
        raise RecordingError(f"{path}: the shape of {key} must be {length} whole numbers, not {brief(shape)}")
    return shape


def _width(path: Path, features: dict[str, dict[str, Any]], key: str) -> int:
    """How many numbers a signal has."""
    if key not in features:
        raise RecordingError(f"{path}: the feature {key} is missing; there are {', '.join(features)}")
    width = _shape(path, key, features[key], 1)[0]
    if width > MOST_COLUMNS:
        raise RecordingError(f"{path}: {key} claims {width} numbers; at most {MOST_COLUMNS} are read")
    return width


def _cameras(path: Path, features: dict[str, dict[str, Any]]) -> dict[str, tuple[str, int, int]]:
    """Key, width and height of each colour camera; depth videos are left out."""
    cameras = {}
    for key, feature in features.items():
        if feature.get("dtype") == "image":
            raise RecordingError(f"{path}: the frames of {key} lie in the tables as images; videos are read")
        if feature.get("dtype") != "video":
            continue
        shape, names = _shape(path, key, feature, 3), feature.get("names")
        first = isinstance(names, list) and names[:1] in (["channels"], ["channel"])
        channels, height, width = shape if first else (shape[2], *shape[:2])
        if channels != 3:
            continue
        if max(height, width) > MAX_EDGE:
            raise RecordingError(f"{path}: {key} claims {width} x {height} pixels; at most {MAX_EDGE} are read")
        cameras[key.removeprefix(IMAGES)] = (key, width, height)
    return cameras


def _template(path: Path, data: dict[str, Any], key: str) -> str:
    """A path with fields for numbers, and no other of Python's format fields."""
    text = data.get(key)
    try:
        parts = list(string.Formatter().parse(text)) if isinstance(text, str) else [("", "?", "", None)]
    except ValueError:
        parts = [("", "?", "", None)]
    for _, name, spec, conversion in parts:
        if name is not None and (name not in FIELDS or conversion or not SPEC.fullmatch(spec or "")):
            raise RecordingError(
                f"{path}: {key} must be a path with {{chunk_index}} and {{file_index}}, not {brief(text)}"
            )
    return str(text)
