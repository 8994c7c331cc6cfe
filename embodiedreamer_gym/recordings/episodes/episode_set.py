"""The interface of a set of episodes, whatever its files, and the checks that its readers and writers share."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from embodiedreamer_gym.errors import RecordingError

STATE, ACTION = "observation.state", "action"
SAME_HZ = 0.02  # relative difference of control rates that count as one: clocks jitter
Frames = Mapping[str, Iterable[np.ndarray]]  # camera -> frames (H, W, 3) uint8


class Episode(ABC):
    """One episode of a set; only what is asked for is read, and nothing is kept.

    length: steps; task: in words, "" where the files do not state it.
    """

    length: int
    task: str

    @abstractmethod
    def numbers(self, key: str) -> np.ndarray:
        """STATE (T, n) or ACTION (T, m), float32."""

    @abstractmethod
    def frames(self, camera: str, start: int, stop: int) -> np.ndarray:
        """Frames start .. stop - 1 of an existing camera, at least one."""

    def masks(self, camera: str, start: int, stop: int) -> np.ndarray:
        """Masks of existing frames."""
        raise NotImplementedError


class EpisodeSet:
    """Episodes of one robot with the frames of its cameras.

    source: file or folder; names: of the episodes; state_size n, action_size m; frame_sizes: camera -> width and height, pixels, {} for a
    set without frames; hz: control rate, Hz, None where it is not known; objects: name of each object -> its number in the
    masks of all cameras (none without masks).
    The action of a step is the one that follows its state and frame.
    """

    def __init__(
        self, source: str, names: Iterable[str], episodes: Sequence[Episode], state_size: int, action_size: int,
        frame_sizes: Mapping[str, tuple[int, int]], hz: float | None = None, objects: Mapping[str, int] | None = None,
    ) -> None:  # fmt: skip
        self.source, self.names, self.episodes, self.cameras = source, tuple(names), tuple(episodes), tuple(frame_sizes)
        self.state_size, self.action_size = state_size, action_size
        self.objects = dict(objects or {})
        self.lengths = tuple(one.length for one in episodes)
        self._hz, self._frame_sizes = hz, dict(frame_sizes)

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

    @property
    def rate(self) -> float:
        """Deprecated: use `hz`."""
        warnings.warn("EpisodeSet.rate is deprecated; use EpisodeSet.hz", DeprecationWarning, stacklevel=2)
        return self.hz

    def task(self, episode: int) -> str:
        """The task in words; "" where the files do not state it."""
        return self.episodes[episode].task

    def states(self, episode: int) -> np.ndarray:
        """States (T, n), float32."""
        return self.episodes[episode].numbers(STATE)

    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m), float32."""
        return self.episodes[episode].numbers(ACTION)

    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""
        return self._frame_sizes[camera]

    def frames(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Frames start .. stop - 1 of a camera, (k, H, W, 3) uint8 RGB; only these are read.

        Raises: RecordingError for a camera or steps that do not exist, and for frames that cannot be read.
        """
        start, stop = self._window(episode, camera, start, stop)
        if start == stop:
            width, height = self.frame_size(camera)
            return np.empty((0, height, width, 3), np.uint8)
        return self._read_frames(episode, camera, start, stop)

    def masks(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Masks (k, H, W) uint8 of the same frames: at each pixel the number of its object or class.

        Raises: RecordingError as `frames`, and where there are no masks.
        """
        if not self.objects:
            raise RecordingError(f"{self.source} has no masks of objects")
        return self._read_masks(episode, camera, *self._window(episode, camera, start, stop))

    def _read_frames(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        return self.episodes[episode].frames(camera, start, stop)

    def _read_masks(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        return self.episodes[episode].masks(camera, start, stop)

    def _window(self, episode: int, camera: str, start: int, stop: int | None) -> tuple[int, int]:
        """Checked start and stop of the steps that are asked for."""
        if camera not in self.cameras:
            raise RecordingError(
                f"{self.source} has no camera '{camera}'; it has {', '.join(self.cameras) or 'no frames at all'}"
            )
        length = self.lengths[episode]
        stop = length if stop is None else stop
        if not 0 <= start <= stop <= length:
            raise RecordingError(f"{self.names[episode]} has the steps 0 .. {length - 1}, not {start} .. {stop - 1}")
        return start, stop

    def __len__(self) -> int:
        return len(self.lengths)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({len(self)} episodes, {sum(self.lengths)} steps, state {self.state_size}, "
            f"action {self.action_size}, cameras {', '.join(self.cameras) or 'none'})"
        )


def check_agreement(
    one: str, other: str, pairs: Iterable[tuple[str, object, object]], rule: str = "all episodes must have the same"
) -> None:
    """Raises: RecordingError for the first (description, value of one, value of the other) whose values differ."""
    for what, a, b in pairs:
        if a != b:
            raise RecordingError(f"{other} has {what} {b}, {one} {a}; {rule}")


def check_numbers(values: np.ndarray, where: str) -> np.ndarray:
    """Return values (T, n) as float32.

    Raises: RecordingError for an array of another form, or one that holds what is not finite.
    """
    if values.ndim != 2 or not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        raise RecordingError(f"{where} is {values.dtype} of shape {values.shape}; numbers of shape (T, n) are expected")
    with np.errstate(over="ignore"):
        values = np.ascontiguousarray(values, np.float32)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise RecordingError(f"{where} is not finite at step {bad[0][0]}, column {bad[0][1]}; leave that episode out")
    return values


def check_frame(frame: np.ndarray, shape: tuple[int, ...], where: str) -> None:
    """Raises: RecordingError for a frame that is not (H, W, 3) uint8, or not of this shape."""
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise RecordingError(f"{where}: a frame is {frame.dtype} of shape {frame.shape}; (H, W, 3) uint8 is expected")
    if frame.shape != shape:
        raise RecordingError(f"{where}: the frames have several sizes; all must have one")


def frame_rows(frames: Frames, count: int, where: str) -> Iterator[dict[str, np.ndarray]]:
    """One frame of each camera at a time, `count` times.

    Raises: RecordingError where a camera has fewer frames, or more.
    """
    sources = {camera: iter(source) for camera, source in frames.items()}
    for step in range(count):
        row = {}
        for camera, source in sources.items():
            frame = next(source, None)
            if frame is None:
                raise RecordingError(
                    f"{where}: camera {camera} has {step} frames for {count} steps; frames are missing"
                )
            row[camera] = np.asarray(frame)
        yield row
    for camera, source in sources.items():
        if next(source, None) is not None:
            raise RecordingError(f"{where}: camera {camera} has more than {count} frames, one per step")
