"""The videos of a LeRobot set, each of many episodes of one camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.recordings.episodes.episode_set import check_frame
from embodiedreamer_gym.recordings.episodes.statistics import FrameStatistics, sampled_frames
from embodiedreamer_gym.recordings.episodes.video import CODECS, GROUP, PIXELS, VideoWriter

FILES = "chunk-{chunk_index:03d}/file-{file_index:03d}"
VIDEO_PATH = "videos/{video_key}/" + FILES + ".mp4"
CHUNK = 1000  # files of a folder
VIDEO_MB = 200  # of a file, before the next one is begun


class CameraVideos:
    """The videos of one camera, the next begun when one is large enough."""

    def __init__(self, folder: Path, key: str, hz: int, codec: str) -> None:
        self.key, self._folder, self._hz, self._codec = key, folder, hz, codec
        self._file = -1
        self._writer: VideoWriter | None = None
        self._first = 0
        self._shape: tuple[int, ...] = ()
        self._length = 0
        self.statistics = FrameStatistics()

    def begin(self, length: int) -> None:
        """Begin an episode of a length."""
        self.statistics, self._sampled = FrameStatistics(), sampled_frames(length)
        writer = self._writer
        if writer is not None and writer.bytes / 2**20 * (1.0 + length / max(writer.count, 1)) >= VIDEO_MB:
            writer.close()
            self._writer = writer = None
        self._first = writer.count if writer is not None else 0

    def add(self, frame: np.ndarray, step: int) -> None:
        """Write a frame (H, W, 3) uint8.

        Raises: RecordingError for one of another kind or size.
        """
        self._shape = self._shape or frame.shape
        check_frame(frame, self._shape, self.key)
        if self._writer is None:
            self._file += 1
            place = VIDEO_PATH.format(
                video_key=self.key, chunk_index=self._file // CHUNK, file_index=self._file % CHUNK
            )
            self._writer = VideoWriter(self._folder / place, self._hz, (frame.shape[1], frame.shape[0]), self._codec)
        self._writer.add(frame)
        if step in self._sampled:
            self.statistics.add(frame)

    def place(self, length: int) -> dict[str, Any]:
        """Columns of the table of episodes: the video of the episode's frames, and its seconds in it."""
        at = f"videos/{self.key}"
        return {
            f"{at}/chunk_index": self._file // CHUNK, f"{at}/file_index": self._file % CHUNK,
            f"{at}/from_timestamp": self._first / self._hz, f"{at}/to_timestamp": (self._first + length) / self._hz,
        }  # fmt: skip

    def feature(self) -> dict[str, Any]:
        """The camera's feature in meta/info.json."""
        height, width = self._shape[:2] or (0, 0)
        options = CODECS[self._codec]
        preset = int(options["preset"]) if "preset" in options else None
        return {
            "dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"],
            "info": {
                "video.height": height, "video.width": width, "video.channels": 3, "video.fps": self._hz,
                "video.codec": {"libx264": "h264", "libsvtav1": "av1"}[self._codec], "video.pix_fmt": PIXELS,
                "video.g": GROUP, "video.crf": int(options["crf"]), "video.preset": preset, "video.fast_decode": 0,
                "video.video_backend": "pyav", "video.extra_options": {}, "has_audio": False, "is_depth_map": False,
            },
        }  # fmt: skip

    def close(self) -> None:
        """Close the video, if one is open."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
