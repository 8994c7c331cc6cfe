"""What `meta/info.json` of a LeRobot set says, held to what may be believed."""

from __future__ import annotations

import json
import re
import string
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.episode_set import LARGEST_EDGE

VERSION = "v3.0"
STATE, ACTION, IMAGES = "observation.state", "action", "observation.images."
FIELDS = ("chunk_index", "file_index", "video_key")
SPEC = re.compile(r"0?\d?d?")  # of a number in a path; more could fill the memory
MOST_COLUMNS = 4096
CONVERT = "python -m lerobot.scripts.convert_dataset_v21_to_v30"


@dataclass(frozen=True)
class Info:
    """A set in numbers: rate in Hz; cameras: name -> key, width and height; templates of its paths."""

    rate: float
    episodes: int
    frames: int
    state_size: int
    action_size: int
    cameras: dict[str, tuple[str, int, int]]
    data_path: str
    video_path: str


def read_info(folder: Path) -> Info:
    """Read meta/info.json of a set.

    Raises: RecordingError where it is missing, of another version, or says what cannot be.
    """
    path = folder / "meta" / "info.json"
    if not path.is_file():
        raise RecordingError(f"{folder}: meta/info.json is missing; a LeRobot set has it")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"{path} is no readable JSON: {error}") from error
    data = data if isinstance(data, dict) else {}
    version = str(data.get("codebase_version"))
    if not version.startswith("v3."):
        raise RecordingError(
            f"{folder} is a LeRobot set of version {version}, but v3 is read; convert it with `{CONVERT}`"
        )
    features = data.get("features")
    if not isinstance(features, dict) or not all(isinstance(value, dict) for value in features.values()):
        raise RecordingError(f"{path}: features must be an object of objects")
    rate = data.get("fps")
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate < 1e6:
        raise RecordingError(f"{path}: fps must be a number above 0, not {rate!r}")
    return Info(
        float(rate), _count(path, data, "total_episodes"), _count(path, data, "total_frames"),
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
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise RecordingError(f"{path}: {key} must be a whole number of at least 1, not {value!r}")
    return value


def _shape(path: Path, key: str, feature: dict[str, Any], length: int) -> list[int]:
    shape = feature.get("shape")
    whole = isinstance(shape, list) and all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in shape)
    if not isinstance(shape, list) or not whole or len(shape) != length:
        raise RecordingError(f"{path}: the shape of {key} must be {length} whole numbers, not {shape!r}")
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
    found = {}
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
        if max(height, width) > LARGEST_EDGE:
            raise RecordingError(f"{path}: {key} claims {width} x {height} pixels; at most {LARGEST_EDGE} are read")
        found[key.removeprefix(IMAGES)] = (key, width, height)
    return found


def _template(path: Path, data: dict[str, Any], key: str) -> str:
    """A path with places for numbers, and nothing else that Python's format knows."""
    text = data.get(key)
    try:
        parts = list(string.Formatter().parse(text)) if isinstance(text, str) else [("", "?", "", None)]
    except ValueError:
        parts = [("", "?", "", None)]
    for _, name, spec, conversion in parts:
        if name is not None and (name not in FIELDS or conversion or not SPEC.fullmatch(spec or "")):
            raise RecordingError(f"{path}: {key} must be a path with {{chunk_index}} and {{file_index}}, not {text!r}")
    return str(text)
