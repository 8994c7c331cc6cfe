"""Episodes of ALOHA and AgileX HDF5 files, one file an episode.

Source: collect_data.py of agilexrobotics/cobot_magic, record_sim_episodes.py of tonyzhaozh/act.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.episode_set import (
    LARGEST_EDGE,
    MOST_NUMBERS,
    EpisodeSet,
    check_numbers,
)
from embodiedreamer_gym.recordings.frames import decode

SAME_RATE = 0.02  # by which the rates of files may differ: clocks jitter
STATE, ACTION, IMAGES = "observations/qpos", "action", "observations/images"
MASKS, CLASSES = "observations/masks", "class_names"  # beside the images; names of the numbers in them, a JSON list
NO_OBJECTS = ("background", "table", "robot")


@dataclass(frozen=True)
class _File:
    """What is known of a file: its length, sizes of its numbers, cameras with width and height, task and rate."""

    path: Path
    length: int
    state_size: int
    action_size: int
    cameras: dict[str, tuple[int, int]]
    task: str
    rate: float | None
    objects: dict[str, int]


class AlohaEpisodes(EpisodeSet):
    """Episodes of HDF5 files: raw frames, or JPEG buffers that are zero-padded or of varying length.

    rate: Hz, where the files do not say it (`rate`, `fps`, `control_hz` or `/timestamps`).
    Raises: RecordingError where a file is damaged or of another layout, or the files disagree with each other.
    """

    def __init__(self, paths: Sequence[Path], rate: float | None = None) -> None:
        if rate is not None and not 0 < rate < np.inf:
            raise RecordingError(f"the rate is {rate:g} Hz; it must be above 0")
        self._files = [_inspect(Path(path)) for path in paths]
        first = self._files[0]
        for other in self._files[1:]:
            _agree(first, other)
        self.source = str(paths[0] if len(paths) == 1 else Path(paths[0]).parent)
        self.cameras = tuple(first.cameras)
        self.state_size, self.action_size = first.state_size, first.action_size
        self.lengths = tuple(file.length for file in self._files)
        self.names = tuple(file.path.stem for file in self._files)
        self.objects = first.objects
        self._rate = rate or next((file.rate for file in self._files if file.rate is not None), None)

    @property
    def rate(self) -> float:
        """Steps per second, Hz.

        Raises: RecordingError where neither the files nor the caller said it.
        """
        if self._rate is None:
            raise RecordingError(f"{self.source} does not say its rate; give it, as open_episodes(path, rate=30)")
        return self._rate

    def task(self, episode: int) -> str:
        """The task in words, of the attribute `instruction`, else `task`; "" without them."""
        return self._files[episode].task

    def states(self, episode: int) -> np.ndarray:
        """Joint positions (T, n), float32."""
        return self._numbers(episode, STATE)

    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m), float32."""
        return self._numbers(episode, ACTION)

    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""
        return self._files[0].cameras[camera]

    def _numbers(self, episode: int, key: str) -> np.ndarray:
        path = self._files[episode].path
        with _opened(path) as file:
            return check_numbers(_dataset(file, path, key)[()], f"{path}: /{key}")

    def _read_masks(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        path = self._files[episode].path
        with _opened(path) as file:
            return _dataset(file, path, f"{MASKS}/{camera}")[start:stop]

    def _read_frames(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        path, key = self._files[episode].path, f"{IMAGES}/{camera}"
        with _opened(path) as file:
            rows = _dataset(file, path, key)[start:stop]
        if rows.ndim == 4:
            return rows
        width, height = self.frame_size(camera)
        frames = np.empty((stop - start, height, width, 3), np.uint8)
        for number, row in enumerate(rows):
            frame = decode(np.asarray(row), f"{path}: frame {start + number} of /{key}")
            if frame.shape != frames.shape[1:]:
                raise RecordingError(
                    f"{path}: frame {start + number} of /{key} is {frame.shape[1]} x {frame.shape[0]}, "
                    f"others are {width} x {height}; all must have one size"
                )
            frames[number] = frame
        return frames


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file; whatever h5py finds wrong with it becomes one sentence."""
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except RecordingError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:  # what h5py raises
        raise RecordingError(f"{path}: damaged, cut short or not an HDF5 file; record or copy it again") from error


def _dataset(file: h5py.File, path: Path, key: str) -> h5py.Dataset:
    """A dataset that lies in this very file."""
    data = file.get(key)
    if not isinstance(data, h5py.Dataset) or data.shape is None:
        raise RecordingError(f"{path}: the dataset /{key} is missing; the ALOHA layout needs it")
    if data.file.filename != file.filename or data.external or data.is_virtual:
        raise RecordingError(f"{path}: /{key} points to another file; copy its numbers into this one")
    return data


def _inspect(path: Path) -> _File:
    """Everything that can be wrong with a file, short of its frames' content."""
    with _opened(path) as file:
        sizes = {}
        for key in (STATE, ACTION):
            data = _dataset(file, path, key)
            if (data.size or 0) > MOST_NUMBERS:
                raise RecordingError(f"{path}: /{key} claims the shape {data.shape}; that is no episode")
            sizes[key] = check_numbers(data[()], f"{path}: /{key}").shape
        length = sizes[STATE][0]
        if length == 0 or sizes[ACTION][0] != length:
            raise RecordingError(
                f"{path}: /{ACTION} has {sizes[ACTION][0]} steps, /{STATE} {length}; they must agree and be at least one"
            )
        cameras = {name: _frame_size(file, path, name, length) for name in _camera_names(file, path)}
        return _File(path, length, sizes[STATE][1], sizes[ACTION][1], cameras, _task(file), _rate(file, path, length),
                     _objects(file, path, cameras, length))  # fmt: skip


def _camera_names(file: h5py.File, path: Path) -> list[str]:
    group = file.get(IMAGES)
    if group is None:
        return []
    if not isinstance(group, h5py.Group):
        raise RecordingError(f"{path}: /{IMAGES} is no group of one dataset per camera")
    return list(group)


def _frame_size(file: h5py.File, path: Path, camera: str, length: int) -> tuple[int, int]:
    """Width and height of a camera's frames, of which there are as many as steps."""
    key = f"{IMAGES}/{camera}"
    data = _dataset(file, path, key)
    raw = data.ndim == 4 and data.shape[3] == 3 and data.dtype == np.uint8
    coded = (data.ndim == 2 and data.dtype == np.uint8) or (
        data.ndim == 1 and h5py.check_vlen_dtype(data.dtype) is not None
    )
    if not raw and not coded:
        raise RecordingError(
            f"{path}: /{key} is {data.dtype} of shape {data.shape}; uint8 (T, H, W, 3) or one JPEG per row is expected"
        )
    if data.shape[0] != length:
        raise RecordingError(f"{path}: /{key} has {data.shape[0]} frames for {length} steps; frames are missing")
    shape = data.shape[1:] if raw else decode(np.asarray(data[0]), f"{path}: frame 0 of /{key}").shape
    if not 0 < min(shape[:2]) <= max(shape[:2]) <= LARGEST_EDGE:
        raise RecordingError(f"{path}: /{key} has frames of {shape[1]} x {shape[0]}; 1 to {LARGEST_EDGE} are allowed")
    return int(shape[1]), int(shape[0])


def _objects(file: h5py.File, path: Path, cameras: dict[str, tuple[int, int]], length: int) -> dict[str, int]:
    """Objects by their number in the masks; none where a camera has no masks, or their numbers no names."""
    try:
        names = json.loads(str(file.attrs.get(CLASSES, "[]")))
    except ValueError:
        names = []
    if not cameras or not isinstance(names, list) or any(f"{MASKS}/{camera}" not in file for camera in cameras):
        return {}
    for camera, (width, height) in cameras.items():
        data = _dataset(file, path, f"{MASKS}/{camera}")
        if data.shape != (length, height, width) or data.dtype != np.uint8:
            raise RecordingError(
                f"{path}: /{MASKS}/{camera} is {data.dtype} of shape {data.shape}; uint8 {(length, height, width)} is expected"
            )
    return {str(name): number for number, name in enumerate(names) if name not in NO_OBJECTS}


def _numbered(objects: Mapping[str, int]) -> str:
    """Objects with their numbers in the masks."""
    return ", ".join(f"{name} ({number})" for name, number in objects.items()) or "nothing"


def _task(file: h5py.File) -> str:
    found = file.attrs.get("instruction", file.attrs.get("task", ""))
    return found.decode(errors="replace") if isinstance(found, bytes) else str(found)


def _rate(file: h5py.File, path: Path, length: int) -> float | None:
    """Hz, as an attribute or as times say it."""
    given: Any = next((file.attrs[key] for key in ("rate", "fps", "control_hz") if key in file.attrs), None)
    if given is None and length > 1 and isinstance(file.get("timestamps"), h5py.Dataset):
        given = 1.0 / max(float(np.median(np.diff(np.ravel(_dataset(file, path, "timestamps")[()])))), 1e-9)
    if given is None:
        return None
    rate = float(np.ravel(given)[0])
    if not 0 < rate < np.inf:
        raise RecordingError(f"{path}: the rate is {rate:g} Hz; it must be above 0")
    return rate


def _agree(one: _File, other: _File) -> None:
    """Raise where two files cannot be of one set."""
    for what, a, b in (
        ("an action size of", one.action_size, other.action_size),
        ("a state size of", one.state_size, other.state_size),
        ("the cameras", ", ".join(one.cameras) or "none", ", ".join(other.cameras) or "none"),
        ("frames of", list(one.cameras.values()), list(other.cameras.values())),
        ("masks of", _numbered(one.objects), _numbered(other.objects)),
    ):
        if a != b:
            raise RecordingError(f"{other.path} has {what} {b}, {one.path.name} {a}; all episodes must have the same")
    if one.rate is not None and other.rate is not None and abs(one.rate - other.rate) > SAME_RATE * one.rate:
        raise RecordingError(f"{other.path} runs at {other.rate:.4g} Hz, {one.path.name} at {one.rate:.4g} Hz")
