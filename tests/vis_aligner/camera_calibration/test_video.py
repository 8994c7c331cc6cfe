"""Frames of video files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.recordings import FrameSource
from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Eight frames, red in one half and ever brighter in the other."""
    path = tmp_path / "v.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 4.0, (64, 48))
    if not writer.isOpened():
        pytest.skip("this build of OpenCV writes no mp4")
    for t in range(8):
        frame = np.full((48, 64, 3), 20 * t, np.uint8)
        frame[:, :32] = (0, 0, 220)  # OpenCV: blue, green, red
        writer.write(frame)
    writer.release()
    return path


def test_frames_are_rgb_and_in_order(video: Path) -> None:
    frames = VideoFrames(video)
    assert isinstance(frames, FrameSource) and len(frames) == 8 and frames[0].shape == (48, 64, 3)
    red, green, blue = frames[3][20, 10].tolist()
    assert red > 180 and max(green, blue) < 60
    assert [round(float(frames[t][:, 40:].mean()) / 20) for t in range(8)] == list(range(8))


def test_a_part_can_be_asked_for(video: Path) -> None:
    frames = VideoFrames(video, length=4, first=2)
    assert len(frames) == 4
    np.testing.assert_array_equal(frames[0], VideoFrames(video)[2])


def test_what_cannot_be_read_is_named(video: Path, tmp_path: Path) -> None:
    with pytest.raises(VisionError, match=r"none.mp4 does not exist"):
        VideoFrames(tmp_path / "none.mp4")
    with pytest.raises(VisionError, match=r"v.mp4 has 8 frames that can be read; 9 frames are needed"):
        VideoFrames(video, length=9)[0]
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(VisionError, match="has 0 frames that can be read; frames are needed"):
        VideoFrames(tmp_path / "text.mp4")[0]
