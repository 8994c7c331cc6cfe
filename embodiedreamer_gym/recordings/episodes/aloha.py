"""Episodes of ALOHA and AgileX HDF5 files, one file an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.episode_set import (
    SAME_HZ,
    STATE,
    Episode,
    EpisodeSet,
    check_agreement,
    check_numbers,
)
from embodiedreamer_gym.recordings.hdf5 import COMMAND, IMAGES, MASKS, POSITION, Hdf5File, open_hdf5, text
from embodiedreamer_gym.recordings.time_axis import check_hz

CLASSES = "class_names"  # attribute: JSON list of the names of the numbers in the masks
NO_OBJECTS = ("background", "table", "robot")


@dataclass(frozen=True)
class AlohaEpisode(Episode):
    """One file: number of steps, sizes of state and action, cameras with width and height, task, Hz, object numbers."""

    path: Path
    length: int
    state_size: int
    action_size: int
    cameras: dict[str, tuple[int, int]]
    task: str
    hz: float | None
    objects: dict[str, int]

    def numbers(self, key: str) -> np.ndarray:
        """Joint positions (T, n) or actions (T, m), float32."""
        with open_hdf5(self.path) as file:
            return _numbers(file, POSITION if key == STATE else COMMAND)

    def masks(self, camera: str, start: int, stop: int) -> np.ndarray:
        """Masks of existing frames."""
        with open_hdf5(self.path) as file:
            return file.read(f"{MASKS}/{camera}", start, stop)

    def frames(self, camera: str, start: int, stop: int) -> np.ndarray:
        """Frames start .. stop - 1 of an existing camera, at least one."""
        key, (width, height) = f"{IMAGES}/{camera}", self.cameras[camera]
        with open_hdf5(self.path) as file:
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


class AlohaEpisodes(EpisodeSet):
    """Episodes of HDF5 files: raw frames, or JPEG buffers that are zero-padded or of varying length.

    hz: control rate, Hz, where the files do not state it (`rate`, `fps`, `control_hz` or `/timestamps`).
    The task is that of the attribute `instruction`, else `task`.
    Raises: RecordingError where a file is damaged or of another layout, or the files disagree with each other.
    """

    def __init__(self, paths: Sequence[Path], hz: float | None = None) -> None:
        source = str(paths[0] if len(paths) == 1 else Path(paths[0]).parent)
        hz = None if hz is None else check_hz(hz, source)
        files = [_inspect(Path(path)) for path in paths]
        first = files[0]
        for other in files[1:]:
            _agree(first, other)
        if hz is None:
            hz = next((file.hz for file in files if file.hz is not None), None)
        names = [file.path.stem for file in files]
        super().__init__(source, names, files, first.state_size, first.action_size, first.cameras, hz, first.objects)


def _numbers(file: Hdf5File, key: str) -> np.ndarray:
    return check_numbers(file.signal(key), f"{file.path}: /{key}")


def _inspect(path: Path) -> AlohaEpisode:
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
        return AlohaEpisode(
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


def _agree(one: AlohaEpisode, other: AlohaEpisode) -> None:
    """Raise where two files cannot be of one set."""
    check_agreement(one.path.name, str(other.path), (
        ("an action size of", one.action_size, other.action_size),
        ("a state size of", one.state_size, other.state_size),
        ("the cameras", ", ".join(one.cameras) or "none", ", ".join(other.cameras) or "none"),
        ("frames of", list(one.cameras.values()), list(other.cameras.values())),
        ("masks of", _list(one.objects), _list(other.objects)),
    ))  # fmt: skip
    if one.hz is not None and other.hz is not None and abs(one.hz - other.hz) > SAME_HZ * one.hz:
        raise RecordingError(f"{other.path} runs at {other.hz:.4g} Hz, {one.path.name} at {one.hz:.4g} Hz")
