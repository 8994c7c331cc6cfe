"""Camera frames of a recording: the interface of a frame source, and image decoding with a size limit."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from embodiedreamer_gym.errors import RecordingError

MAX_EDGE = 8192  # pixels; largest allowed edge of a frame
PNG = b"\x89PNG\r\n\x1a\n"
JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers of the segments that hold height and width


@runtime_checkable
class FrameSource(Protocol):
    """Frames of one camera: `len(frames)`, and `frames[i]` is (H, W, 3) uint8 RGB."""

    def __len__(self) -> int:
        """Number of frames, one per sample of the recording."""
        ...

    def __getitem__(self, index: int) -> np.ndarray:
        """Frame `index`, (H, W, 3) uint8 RGB."""
        ...


def decode(buffer: np.ndarray, where: str) -> np.ndarray:
    """RGB image (H, W, 3) uint8 of one JPEG or PNG byte buffer; zeros may follow the image.

    A JPEG is decoded to RGB, as the standard says. If a logger passed RGB pixels to OpenCV's encoder (which expects
    BGR), red and blue are swapped in its file, and stay swapped here.
    where: description of the image, for messages.
    Raises: RecordingError where the data are neither JPEG nor PNG, or a side is longer than MAX_EDGE.
    """
    data = buffer.tobytes()
    size = _image_size(data)
    if size is not None and max(size) > MAX_EDGE:
        raise RecordingError(f"{where} claims {size[0]} x {size[1]} pixels; at most {MAX_EDGE} are read")
    try:
        image = None if size is None else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError(f"{where} is not a JPEG or PNG image; write raw uint8 frames or JPEG buffers")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def _image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the header of a JPEG or PNG states; None for other data."""
    if data.startswith(PNG):
        return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    place = 2 if data.startswith(b"\xff\xd8") else len(data)
    while place + 9 <= len(data) and data[place] == 0xFF:
        if data[place + 1] in JPEG_SIZES:
            return int.from_bytes(data[place + 7 : place + 9]), int.from_bytes(data[place + 5 : place + 7])
        place += 1 if data[place + 1] == 0xFF else 2 + int.from_bytes(data[place + 2 : place + 4])
    return None
