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
READ = ("v2.0", "v2.1", "v3.")  # beginnings of versions that are read
IMAGES = "observation.images."  # before the names of the cameras
OPTIONAL = {"velocity": "observation.velocity", "effort": "observation.effort"}  # of ALOHA sets
FIELDS = ("chunk_index", "file_index", "video_key", "episode_chunk", "episode_index")
SPEC = re.compile(r"0?\d?d?")  # format of a number in a path; wider ones could fill the memory
MOST_COLUMNS = 4096
CHUNK = 1000  # episodes of a folder of a v2 set that does not state it


@dataclass(frozen=True)
class Info:
    """hz: frames per second; counts of the set; cameras: name -> key, width and height; templates of its paths.

    widths: signal -> how many numbers it has; names: signal -> their names, () where there are none; chunk: episodes of a
    folder of a v2 set, None for v3; robot: its type, "" where it is not stated.
    """

    hz: float
    episodes: int
    frames: int
    widths: dict[str, int]
    names: dict[str, tuple[str, ...]]
    cameras: dict[str, tuple[str, int, int]]
    data_path: str
    video_path: str
    chunk: int | None
    robot: str

    @property
    def state_size(self) -> int:
        """How many numbers a state has."""
        return self.widths[STATE]

    @property
    def action_size(self) -> int:
        """How many numbers an action has."""
        return self.widths[ACTION]


def read_info(folder: Path, videos: bool = True) -> Info:
    """Read meta/info.json of a set; videos: False leaves out all that is said of cameras.

    Raises: RecordingError where it is missing, of another version, or holds impossible values.
    """
    path = folder / "meta" / "info.json"
    if not path.is_file():
        raise RecordingError(f"{folder}: meta/info.json is missing; a LeRobot set has it")
    data = read_json(path, RecordingError)
    data = data if isinstance(data, dict) else {}
    version = str(data.get("codebase_version"))
    if not version.startswith(READ):
        raise RecordingError(f"{folder} is a LeRobot set of version {brief(version)}; v2.0, v2.1 and v3 are read")
    features = data.get("features")
    if not isinstance(features, dict) or not all(isinstance(value, dict) for value in features.values()):
        raise RecordingError(f"{path}: features must be an object of objects")
    fps = data.get("fps")
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not ALLOWED_HZ[0] <= fps <= ALLOWED_HZ[1]:
        raise RecordingError(f"{path}: fps must be a number above 0, not {brief(fps)}")
    signals = (STATE, ACTION, *(key for key in OPTIONAL.values() if key in features))
    widths = {key: _width(path, features, key) for key in signals}
    return Info(
        float(fps), _count(path, data, "total_episodes"), _count(path, data, "total_frames"), widths,
        {key: _names(features[key].get("names"), width) for key, width in widths.items()},
        _cameras(path, features) if videos else {}, _template(path, data, "data_path"),
        _template(path, data, "video_path") if videos and data.get("video_path") else "",
        _count(path, {"chunks_size": CHUNK} | data, "chunks_size") if version.startswith("v2") else None,
        str(data.get("robot_type") or "")[:60],
    )  # fmt: skip


def inside(folder: Path, template: str, chunk: int, file: int, key: str = "") -> Path:
    """Path of a file of the set.

    Raises: RecordingError where it would lie outside the set's folder.
    """
    text = template.format(chunk_index=chunk, file_index=file, episode_chunk=chunk, episode_index=file, video_key=key)
    parts = PurePosixPath(text)
    if parts.is_absolute() or ".." in parts.parts or "\\" in text or PureWindowsPath(text).drive:
        raise RecordingError(f"{folder}: meta/info.json names the file {text}, outside the set; it is not opened")
    return folder / parts


def _count(path: Path, data: dict[str, Any], key: str) -> int:
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MAX_NUMBERS:
        raise RecordingError(f"{path}: {key} must be a whole number from 1 to {MAX_NUMBERS}, not {brief(value)}")
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


def _names(value: Any, width: int) -> tuple[str, ...]:
    """Names of a signal's numbers: a list, or an object or list around one; () where they are no names or do not fit."""
    if isinstance(value, dict) and len(value) == 1:
        value = next(iter(value.values()))
    if isinstance(value, list) and len(value) == 1 and isinstance(value[0], list):
        value = value[0]
    good = isinstance(value, list) and len(value) == width and all(isinstance(name, str) for name in value)
    return tuple(value) if good and len(set(value)) == width else ()


def _cameras(path: Path, features: dict[str, dict[str, Any]]) -> dict[str, tuple[str, int, int]]:
    """Key, width and height of each colour camera; depth videos are left out."""
    cameras = {}
    for key, feature in features.items():
        if feature.get("dtype") == "image":
            raise RecordingError(
                f"{path}: the frames of {key} are stored in the tables as images; only videos can be read"
            )
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
            raise RecordingError(f"{path}: {key} must be a path with fields such as {{chunk_index}}, not {brief(text)}")
    return str(text)
