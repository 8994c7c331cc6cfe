"""Videos frame by frame: written one after another, read at exact times."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.extras import load_extra
from embodiedreamer_gym.recordings.frames import MAX_EDGE
from embodiedreamer_gym.recordings.hdf5 import MAX_BYTES

PIXELS = "yuv420p"
GROUP = 2  # frames from one key frame to the next, as LeRobot has it: any frame is near one
CODECS: dict[str, dict[str, str]] = {  # one thread: the same bytes on every machine
    "libx264": {"g": str(GROUP), "crf": "20", "threads": "1", "bf": "0", "rc-lookahead": "0"},
    "libsvtav1": {"g": str(GROUP), "crf": "30", "preset": "12", "svtav1-params": "fast-decode=0:lp=1"},
}
AHEAD = 8  # frames that are decoded and skipped rather than found by a new search
OPEN = 6  # videos that are kept open
NEAR = 0.25  # of a frame's duration, by which its time may differ from the requested one


def check_video(size: tuple[int, int], codec: str = "libx264") -> None:
    """Check that frames of a size (width, height) can be encoded by a codec.

    Raises: RecordingError for an unknown codec, or a size that it cannot encode; MissingExtraError without av.
    """
    for name in ("av", "pyarrow"):
        load_extra(name)
    if codec not in CODECS:
        raise RecordingError(f"codec {codec!r} is not one of {', '.join(CODECS)}")
    if size[0] % 2 or size[1] % 2:
        raise RecordingError(f"frames of {size[0]} x {size[1]} cannot be a video: width and height must be even")


class VideoWriter:
    """Writes frames (H, W, 3) uint8 into an mp4 file; frame k is shown at k / hz seconds.

    count: frames so far; bytes: encoded so far.
    Raises: as `check_video`.
    """

    def __init__(self, path: Path, hz: int, size: tuple[int, int], codec: str = "libx264") -> None:
        check_video(size, codec)
        if codec == "libsvtav1":
            os.environ.setdefault("SVT_LOG", "1")  # errors only; otherwise it prints a page for each video
        self._av = load_extra("av")
        self.count, self.bytes = 0, 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._container = self._av.open(str(path), "w")
        self._stream = self._container.add_stream(codec, rate=hz, options=dict(CODECS[codec]))
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = PIXELS
        self._tick = Fraction(1, hz)
        self._converter = load_extra("av.video.reformatter").VideoReformatter()

    def add(self, pixels: np.ndarray) -> None:
        """Write the next frame."""
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
        frame = self._converter.reformat(frame, format=PIXELS, threads=1)  # a new converter for each frame is slow
        frame.pts, frame.time_base = self.count, self._tick
        packets = self._stream.encode(frame)
        self._container.mux(packets)
        self.count, self.bytes = self.count + 1, self.bytes + sum(packet.size for packet in packets)

    def close(self) -> None:
        """Write what the encoder still holds."""
        self._container.mux(self._stream.encode())
        self._container.close()


class VideoReader:
    """Reads frames of videos by their times; videos stay open, so that consecutive frames need no search.

    Raises: MissingExtraError without av.
    """

    def __init__(self) -> None:
        load_extra("av")
        self._open: OrderedDict[Path, _Decoder] = OrderedDict()
        self._process = os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        return {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__()

    def read(self, path: Path, times: np.ndarray, hz: float, size: tuple[int, int]) -> np.ndarray:
        """Frames (k, H, W, 3) uint8 at increasing times (k,), s; hz: frames per second; size: width and height of the frames.

        Raises: RecordingError where the video cannot be read, ends too early, has no frame at a time or another size.
        """
        shape = (len(times), size[1], size[0], 3)
        if math.prod(shape) > MAX_BYTES:
            raise RecordingError(
                f"{path}: {len(times)} frames of {size[0]} x {size[1]} do not fit into memory; read fewer"
            )
        frames = np.empty(shape, np.uint8)
        if self._process != os.getpid():  # a decoder does not survive a fork
            self._open, self._process = OrderedDict(), os.getpid()
        try:
            decoder = self._open.pop(path, None) or _Decoder(path, size)
            for number, time in enumerate(times):
                frames[number] = decoder.at(float(time), hz)
        except (load_extra("av").FFmpegError, OSError, UnicodeError, IndexError, OverflowError, MemoryError) as error:
            raise RecordingError(f"{path}: damaged, cut short or not a video; copy it again") from error
        self._open[path] = decoder
        while len(self._open) > OPEN:
            self._open.popitem(last=False)[1].close()
        return frames


class _Decoder:
    """One open video and the frame that was decoded last. size: width and height that the frames must have."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self._path, self._size = path, size
        self._container = load_extra("av").open(str(path), format="mp4")  # not a playlist, which could name other files
        self._stream = self._container.streams.video[0]
        codec = self._stream.codec_context
        if codec is None:
            raise RecordingError(f"{path}: its video has no codec that can be read; copy it again")
        self._check_size(codec)
        codec.options = {"max_pixels": str(MAX_EDGE**2)}
        self._tick = float(self._stream.time_base or 0) or 1.0
        codec.thread_count = 1  # more threads delay the first frame after a search
        self._converter = load_extra("av.video.reformatter").VideoReformatter()
        self._frames: Iterator[Any] = iter(())
        self._last: Any = None

    def at(self, time: float, hz: float) -> np.ndarray:
        """Pixels (H, W, 3) of the frame at a time, s."""
        margin = NEAR / hz
        if self._last is None or not -margin <= time - self._when(self._last) <= AHEAD / hz:
            self._seek(time, margin)
        while self._last is not None and self._when(self._last) < time - margin:
            self._last = next(self._frames, None)
        if self._last is None:
            raise RecordingError(f"{self._path}: it ends before {time:.3f} s; frames are missing")
        if self._when(self._last) > time + margin:
            raise RecordingError(f"{self._path}: there is no frame at {time:.3f} s; frames are missing")
        self._check_size(self._last)
        return self._converter.reformat(self._last, format="rgb24", threads=1).to_ndarray()

    def close(self) -> None:
        self._container.close()

    def _check_size(self, one: Any) -> None:
        """Raises: RecordingError for a frame or codec of another size."""
        if (one.width, one.height) != self._size:
            raise RecordingError(f"{self._path}: the frames are {one.width} x {one.height}, "
                                 f"not {self._size[0]} x {self._size[1]} as meta/info.json states")  # fmt: skip

    def _when(self, frame: Any) -> float:
        return frame.pts * self._tick

    def _seek(self, time: float, margin: float) -> None:
        """Decode the key frame before a time, or the first frame."""
        for target in (time, 0.0):
            ticks = max(round(target / self._tick) - 1, 0)
            self._container.seek(ticks, stream=self._stream, backward=True)
            self._frames = (frame for frame in self._container.decode(self._stream) if frame.pts is not None)
            self._last = next(self._frames, None)
            if self._last is not None and self._when(self._last) <= time + margin:
                return
