"""Videos frame by frame: written one after another, read at exact times."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.extra import needed

PIXELS = "yuv420p"
GROUP = 2  # frames from one key frame to the next, as LeRobot has it: any frame is near one
CODECS: dict[str, dict[str, str]] = {  # one thread: the same bytes on every machine
    "libx264": {"g": str(GROUP), "crf": "20", "threads": "1", "bf": "0", "rc-lookahead": "0"},
    "libsvtav1": {"g": str(GROUP), "crf": "30", "preset": "12", "svtav1-params": "fast-decode=0:lp=1"},
}
AHEAD = 8  # frames that are decoded and left out rather than sought anew
OPEN = 6  # videos that are kept open
NEAR = 0.25  # of a frame's duration, within which a frame must be of its time


def check_video(size: tuple[int, int], codec: str = "libx264") -> None:
    """Raise what speaks against videos of a size (width, height) by a codec.

    Raises: RecordingError for a codec that there is not, or a size that it cannot take; MissingExtraError without av.
    """
    for name in ("av", "pyarrow"):
        needed(name)
    if codec not in CODECS:
        raise RecordingError(f"codec {codec!r} is none of {', '.join(CODECS)}")
    if size[0] % 2 or size[1] % 2:
        raise RecordingError(f"frames of {size[0]} x {size[1]} cannot be a video: width and height must be even")


class VideoWriter:
    """Writes frames (H, W, 3) uint8 into an mp4 file; frame k stands at k / rate seconds.

    count: frames so far; bytes: of them that are encoded.
    Raises: as `check_video`.
    """

    def __init__(self, path: Path, rate: int, size: tuple[int, int], codec: str = "libx264") -> None:
        check_video(size, codec)
        if codec == "libsvtav1":
            os.environ.setdefault("SVT_LOG", "1")  # errors alone; it would print a page for each video
        self._av = needed("av")
        self.count, self.bytes = 0, 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._container = self._av.open(str(path), "w")
        self._stream = self._container.add_stream(codec, rate=rate, options=dict(CODECS[codec]))
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = PIXELS
        self._tick = Fraction(1, rate)
        self._converter = needed("av.video.reformatter").VideoReformatter()

    def add(self, pixels: np.ndarray) -> None:
        """Write the next frame."""
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
        frame = self._converter.reformat(frame, format=PIXELS, threads=1)  # a converter of each frame's own is slow
        frame.pts, frame.time_base = self.count, self._tick
        packets = self._stream.encode(frame)
        self._container.mux(packets)
        self.count, self.bytes = self.count + 1, self.bytes + sum(packet.size for packet in packets)

    def close(self) -> None:
        """Write what the encoder still holds."""
        self._container.mux(self._stream.encode())
        self._container.close()


class VideoReader:
    """Reads frames of videos by their times; videos stay open, so that the next frames need no search.

    Raises: MissingExtraError without av.
    """

    def __init__(self) -> None:
        needed("av")
        self._open: OrderedDict[Path, _Decoder] = OrderedDict()
        self._process = os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        return {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__()

    def read(self, path: Path, times: np.ndarray, rate: float, size: tuple[int, int]) -> np.ndarray:
        """Frames (k, H, W, 3) uint8 at rising times (k,), s; size: width and height they must have.

        Raises: RecordingError where the video cannot be read, ends too early, has no frame at a time or another size.
        """
        frames = np.empty((len(times), size[1], size[0], 3), np.uint8)
        if self._process != os.getpid():  # a decoder does not survive a fork
            self._open, self._process = OrderedDict(), os.getpid()
        try:
            decoder = self._open.pop(path, None) or _Decoder(path)
            for number, time in enumerate(times):
                pixels = decoder.at(float(time), rate)
                if pixels.shape != frames.shape[1:]:
                    raise RecordingError(f"{path}: the frames are {pixels.shape[1]} x {pixels.shape[0]}, "
                                         f"not {size[0]} x {size[1]} as meta/info.json says")  # fmt: skip
                frames[number] = pixels
        except (needed("av").FFmpegError, OSError, IndexError) as error:
            raise RecordingError(f"{path}: damaged, cut short or not a video; copy it again") from error
        self._open[path] = decoder
        while len(self._open) > OPEN:
            self._open.popitem(last=False)[1].close()
        return frames


class _Decoder:
    """One open video and where it stands."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._container = needed("av").open(str(path), format="mp4")  # not a playlist of somebody else's choice
        self._stream = self._container.streams.video[0]
        self._tick = float(self._stream.time_base)
        self._stream.codec_context.thread_count = 1  # others would make the first frame after a search wait
        self._converter = needed("av.video.reformatter").VideoReformatter()
        self._frames: Iterator[Any] = iter(())
        self._here: Any = None  # the frame decoded last

    def at(self, time: float, rate: float) -> np.ndarray:
        """Pixels (H, W, 3) of the frame at a time, s."""
        margin = NEAR / rate
        if self._here is None or not -margin <= time - self._when(self._here) <= AHEAD / rate:
            self._seek(time, margin)
        while self._here is not None and self._when(self._here) < time - margin:
            self._here = next(self._frames, None)
        if self._here is None:
            raise RecordingError(f"{self._path}: it ends before {time:.3f} s; frames are missing")
        if self._when(self._here) > time + margin:
            raise RecordingError(f"{self._path}: there is no frame at {time:.3f} s; frames are missing")
        return self._converter.reformat(self._here, format="rgb24", threads=1).to_ndarray()

    def close(self) -> None:
        self._container.close()

    def _when(self, frame: Any) -> float:
        return frame.pts * self._tick

    def _seek(self, time: float, margin: float) -> None:
        """Stand at the key frame before a time, or at the first frame."""
        for target in (time, 0.0):
            ticks = max(round(target / self._tick) - 1, 0)
            self._container.seek(ticks, stream=self._stream, backward=True)
            self._frames = (frame for frame in self._container.decode(self._stream) if frame.pts is not None)
            self._here = next(self._frames, None)
            if self._here is not None and self._when(self._here) <= time + margin:
                return
