"""Episodes of ALOHA and AgileX HDF5 files, one file an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.episode_set import SAME_HZ, EpisodeSet, check_numbers
from embodiedreamer_gym.recordings.hdf5 import COMMAND, IMAGES, MASKS, POSITION, Hdf5File, open_hdf5, text
from embodiedreamer_gym.recordings.time_axis import check_hz

CLASSES = "class_names"  # attribute: JSON list of the names of the numbers in the masks
NO_OBJECTS = ("background", "table", "robot")


@dataclass(frozen=True)
class _File:
    """One file: number of steps, sizes of state and action, cameras with width and height, task, Hz, object numbers."""

    path: Path
    length: int
    state_size: int
    action_size: int
    cameras: dict[str, tuple[int, int]]
    task: str
    hz: float | None
    objects: dict[str, int]


class AlohaEpisodes(EpisodeSet):
    """Episodes of HDF5 files: raw frames, or JPEG buffers that are zero-padded or of varying length.

    hz: control rate, Hz, where the files do not state it (`rate`, `fps`, `control_hz` or `/timestamps`).
    Raises: RecordingError where a file is damaged or of another layout, or the files disagree with each other.
    """

    def __init__(self, paths: Sequence[Path], hz: float | None = None) -> None:
        self.source = str(paths[0] if len(paths) == 1 else Path(paths[0]).parent)
        self._hz = None if hz is None else check_hz(hz, self.source)
        self._files = [_inspect(Path(path)) for path in paths]
        first = self._files[0]
        for other in self._files[1:]:
            _agree(first, other)
        self.cameras = tuple(first.cameras)
        self.state_size, self.action_size = first.state_size, first.action_size
        self.lengths = tuple(file.length for file in self._files)
        self.names = tuple(file.path.stem for file in self._files)
        self.objects = first.objects
        if self._hz is None:
            self._hz = next((file.hz for file in self._files if file.hz is not None), None)

    @property
    def hz(self) -> float:
        """Steps per second, Hz.

        Raises: RecordingError where neither the files nor the caller stated it.
        """
        if self._hz is None:
            raise RecordingError(
                f"{self.source} does not state its control rate; give it, as open_episodes(path, hz=30)"
            )
        return self._hz

    def task(self, episode: int) -> str:
        """The task in words, of the attribute `instruction`, else `task`; "" without them."""
        return self._files[episode].task

    def states(self, episode: int) -> np.ndarray:
        """Joint positions (T, n), float32."""
        return self._numbers(episode, POSITION)

    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m), float32."""
        return self._numbers(episode, COMMAND)

    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""
        return self._files[0].cameras[camera]

    def _numbers(self, episode: int, key: str) -> np.ndarray:
        with open_hdf5(self._files[episode].path) as file:
            return _numbers(file, key)

    def _read_masks(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        with open_hdf5(self._files[episode].path) as file:
            return file.read(f"{MASKS}/{camera}", start, stop)

    def _read_frames(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        path, key = self._files[episode].path, f"{IMAGES}/{camera}"
        width, height = self.frame_size(camera)
        with open_hdf5(path) as file:
            if file.dataset(key).ndim == 4:
                return file.read(key, start, stop)
            file.reserve(key, (stop - start) * height * width * 3)
            frames = np.empty((stop - start, height, width, 3), np.uint8)
            for number, frame in enumerate(file.frames(camera, start, stop)):
                if frame.shape != frames.shape[1:]:
                    raise file.error(
                        f"frame {start + number} of /{key} is {frame.shape[1]} x {frame.shape[0]}, "
                        f"others are {width} x {height}; all must have one size"
                    )
                frames[number] = frame
        return frames


def _numbers(file: Hdf5File, key: str) -> np.ndarray:
    return check_numbers(file.signal(key), f"{file.path}: /{key}")


def _inspect(path: Path) -> _File:
    """Check all of a file but the content of its frames."""
    with open_hdf5(path) as file:
        state, action = _numbers(file, POSITION), _numbers(file, COMMAND)
        length = len(state)
        if length == 0 or len(action) != length:
            raise file.error(
                f"/{COMMAND} has {len(action)} steps, /{POSITION} {length}; they must agree and be at least one"
            )
        cameras = {}
        for camera, data in file.cameras().items():
            if data.shape[0] != length:
                raise file.error(
                    f"/{IMAGES}/{camera} has {data.shape[0]} frames for {length} steps; frames are missing"
                )
            height, width = (data.shape[1:] if data.ndim == 4 else next(file.frames(camera, 0, 1)).shape)[:2]
            cameras[camera] = (int(width), int(height))
        hz = file.hz()
        if hz is None and length > 1 and (times := file.times(state)) is not None:
            hz = check_hz(1.0 / float(np.median(np.diff(times[0]))), str(path))
        task = file.file.attrs.get("instruction", file.file.attrs.get("task", ""))
        return _File(
            path, length, state.shape[1], action.shape[1], cameras, text(task), hz, _objects(file, cameras, length)
        )


def _objects(file: Hdf5File, cameras: Mapping[str, tuple[int, int]], length: int) -> dict[str, int]:
    """Number of each object in the masks; none where a camera has no masks, or their numbers no names."""
    try:
        names = file.json(CLASSES, [])
    except RecordingError:
        names = []
    if not cameras or not isinstance(names, list) or any(f"{MASKS}/{camera}" not in file for camera in cameras):
        return {}
    for camera, (width, height) in cameras.items():
        data = file.dataset(f"{MASKS}/{camera}")
        if data.shape != (length, height, width) or data.dtype != np.uint8:
            raise file.error(
                f"/{MASKS}/{camera} is {data.dtype} of shape {data.shape}; uint8 {(length, height, width)} is expected"
            )
    return {str(name): number for number, name in enumerate(names) if name not in NO_OBJECTS}


def _list(objects: Mapping[str, int]) -> str:
    """Objects with their numbers in the masks, as text."""
    return ", ".join(f"{name} ({number})" for name, number in objects.items()) or "nothing"


def _agree(one: _File, other: _File) -> None:
    """Raise where two files cannot be of one set."""
    for what, a, b in (
        ("an action size of", one.action_size, other.action_size),
        ("a state size of", one.state_size, other.state_size),
        ("the cameras", ", ".join(one.cameras) or "none", ", ".join(other.cameras) or "none"),
        ("frames of", list(one.cameras.values()), list(other.cameras.values())),
        ("masks of", _list(one.objects), _list(other.objects)),
    ):
        if a != b:
            raise RecordingError(f"{other.path} has {what} {b}, {one.path.name} {a}; all episodes must have the same")
    if one.hz is not None and other.hz is not None and abs(one.hz - other.hz) > SAME_HZ * one.hz:
        raise RecordingError(f"{other.path} runs at {other.hz:.4g} Hz, {one.path.name} at {one.hz:.4g} Hz")
