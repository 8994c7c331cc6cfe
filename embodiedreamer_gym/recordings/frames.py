"""Camera frames of a recording, read only when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import h5py
import numpy as np

from embodiedreamer_gym.errors import RecordingError


@runtime_checkable
class FrameSource(Protocol):
    """Frames of one camera: `len(frames)`, and `frames[i]` is (H, W, 3) uint8 RGB."""

    def __len__(self) -> int:
        """Number of frames, one per sample of the recording."""
        ...

    def __getitem__(self, index: int) -> np.ndarray:
        """Frame `index`, (H, W, 3) uint8 RGB."""
        ...


@dataclass(frozen=True)
class Hdf5Frames:
    """Frames of one HDF5 dataset; the file is opened for each access, so nothing stays in memory.

    Raw (T, H, W, 3) uint8, or one JPEG per row: zero-padded (T, L) uint8, or rows of varying length.
    A JPEG is decoded as the standard says, to RGB; a logger that handed RGB pixels to OpenCV's encoder (which
    expects BGR) has swapped red and blue in its file, and they come out swapped.
    """

    path: str
    dataset: str
    length: int

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> np.ndarray:
        if not -self.length <= index < self.length:
            raise IndexError(f"frame {index} of {self.length} in {self.dataset}")
        index = int(index) % self.length
        try:
            with h5py.File(self.path, "r") as file:
                row = np.asarray(file[self.dataset][index])  # pyright: ignore[reportIndexIssue]
        except (OSError, KeyError) as error:
            raise RecordingError(f"{self.path}: frame {index} of {self.dataset} cannot be read") from error
        if row.ndim == 3:
            return np.ascontiguousarray(row, dtype=np.uint8)
        return decode(row, f"{self.path}: frame {index} of {self.dataset}")


def decode(buffer: np.ndarray, where: str) -> np.ndarray:
    """RGB image of one JPEG or PNG byte buffer.

    Raises: RecordingError where it is neither; `where` says which one it is.
    """
    raw = np.frombuffer(buffer.tobytes(), np.uint8) if buffer.dtype != np.uint8 else buffer
    image = cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
    if image is None:
        raise RecordingError(f"{where} is not a JPEG or PNG image; write raw uint8 frames or JPEG buffers")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
