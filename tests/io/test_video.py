"""Frames as a video file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.video import write_video

FRAMES = np.full((4, 16, 24, 3), [200, 60, 20], np.uint8)


def test_a_video_has_the_frames_and_their_number_per_second(tmp_path: Path) -> None:
    write_video(FRAMES, tmp_path / "red.mp4", fps=5)
    video = cv2.VideoCapture(str(tmp_path / "red.mp4"))
    assert (video.get(cv2.CAP_PROP_FPS), video.get(cv2.CAP_PROP_FRAME_COUNT)) == (5, 4)
    assert np.abs(video.read()[1][..., ::-1].astype(int) - FRAMES[0]).max() < 12
    assert [path.name for path in tmp_path.iterdir()] == ["red.mp4"]


def test_the_former_name_of_fps_works_with_a_warning(tmp_path: Path) -> None:
    with pytest.warns(DeprecationWarning, match="'rate' of write_video is now 'fps'"):
        write_video(FRAMES, tmp_path / "red.mp4", rate=5)


@pytest.mark.parametrize("name", ["red.avi", "nowhere/red.mp4"])
def test_a_video_that_cannot_be_written_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(VisionError, match="cannot be written"):
        write_video(FRAMES, tmp_path / name)
