"""What every set of episodes offers, whichever files it lies in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from embodiedreamer_gym.errors import RecordingError

MOST_NUMBERS = 10**8  # of one episode's states; a file that claims more lies about its shape
LARGEST_EDGE = 8192  # pixels


class EpisodeSet(ABC):
    """Episodes of one robot with the frames of its cameras; what is asked for is read, and nothing is kept.

    cameras: names, none for a set without frames; state_size n, action_size m; lengths: steps of each episode; names: of
    the episodes; objects: of each object that the masks of all cameras tell apart, its number in them (none without masks).
    The action of a step is the one that follows its state and frame.
    """

    cameras: tuple[str, ...]
    state_size: int
    action_size: int
    lengths: tuple[int, ...]
    names: tuple[str, ...]
    source: str
    objects: Mapping[str, int] = {}

    @property
    @abstractmethod
    def rate(self) -> float:
        """Steps per second, Hz.

        Raises: RecordingError where neither the files nor the caller said it.
        """

    @abstractmethod
    def task(self, episode: int) -> str:
        """The task in words; "" where the files do not say it."""

    @abstractmethod
    def states(self, episode: int) -> np.ndarray:
        """States (T, n), float32."""

    @abstractmethod
    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m), float32."""

    @abstractmethod
    def _read_frames(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        """Frames start .. stop - 1 of a camera that there is, at least one."""

    @abstractmethod
    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""

    def frames(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Frames start .. stop - 1 of a camera, (k, H, W, 3) uint8 RGB; only these are read.

        Raises: RecordingError for a camera or steps that there are not, and for frames that cannot be read.
        """
        start, stop = self._window(episode, camera, start, stop)
        if start == stop:
            width, height = self.frame_size(camera)
            return np.empty((0, height, width, 3), np.uint8)
        return self._read_frames(episode, camera, start, stop)

    def masks(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Masks (k, H, W) uint8 of the same frames: at each pixel the number of what is there.

        Raises: RecordingError as `frames`, and where there are no masks.
        """
        if not self.objects:
            raise RecordingError(f"{self.source} has no masks of objects")
        return self._read_masks(episode, camera, *self._window(episode, camera, start, stop))

    def _read_masks(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        """Masks of frames that there are."""
        raise NotImplementedError

    def _window(self, episode: int, camera: str, start: int, stop: int | None) -> tuple[int, int]:
        """First and last but one of the steps that are asked for."""
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
