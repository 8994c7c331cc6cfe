"""Frames of a video file as the frames of a recording."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError


class VideoFrames:
    """Frames of a video file, each (H, W, 3), uint8 RGB; the file is read when the first frame is requested.

    length: number of frames; None: all.
    first: number of frames to skip at the beginning of the file.
    Raises: VisionError when the file does not exist; on reading, when it is not a video or has too few frames.
    """

    def __init__(self, path: str | Path, length: int | None = None, first: int = 0) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise VisionError(f"video {self.path} does not exist.")
        self._wanted, self._first = length, first
        self._frames: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"VideoFrames({self.path.name!r})"

    def __len__(self) -> int:
        return len(self._all()) if self._wanted is None else self._wanted

    def __getitem__(self, index: int) -> np.ndarray:
        """Frame `index`, (H, W, 3) uint8 RGB."""
        return self._all()[index]

    def _all(self) -> np.ndarray:
        if self._frames is None:
            self._frames = self._read()
        return self._frames

    def _read(self) -> np.ndarray:
        video = cv2.VideoCapture(str(self.path))
        frames = []
        end = None if self._wanted is None else self._first + self._wanted
        while end is None or len(frames) < end:
            good, frame = video.read()
            if not good:
                break
            frames.append(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        video.release()
        if not frames or (end is not None and len(frames) < end):
            wanted = "frames" if end is None else f"{end} frames"
            raise VisionError(f"video {self.path} has {len(frames)} frames that can be read; {wanted} are needed.")
        return np.stack(frames[self._first :])
