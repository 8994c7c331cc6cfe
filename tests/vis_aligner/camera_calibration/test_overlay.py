"""Pictures of the predicted outline over the frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.vis_aligner.camera_calibration import View
from embodiedreamer_gym.vis_aligner.camera_calibration.overlay import (
    INNER,
    MARK,
    OUTLINE,
    SEEN,
    draw_marks,
    draw_outlines,
    overlay,
)
from tests.vis_aligner.camera_calibration.conftest import TRUTH, Bench, marks_of, surface


def pixels(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return (picture == colour).all(axis=2)


def test_the_outline_lies_on_the_robots_edge(bench: Bench) -> None:
    view, pose = View.from_camera(TRUTH), surface().poses(bench.angles)[3]
    picture = draw_outlines(bench.frames[3], surface().body, pose, view)
    assert picture.shape == (360, 480, 3) and pixels(picture, INNER).sum() > 100
    mask = cv2.resize(bench.masks[3].astype(np.uint8), (480, 360), interpolation=cv2.INTER_NEAREST)
    edge = cv2.dilate(mask, np.ones((7, 7), np.uint8)) > cv2.erode(mask, np.ones((7, 7), np.uint8))
    green = pixels(picture, OUTLINE)
    assert green.sum() > 300 and (green & edge).sum() > 0.98 * green.sum()


def test_frames_stand_side_by_side(bench: Bench) -> None:
    view = View.from_camera(TRUTH)
    assert overlay(surface().body, bench.footage(), view, count=4).shape == (720, 1440, 3)
    assert overlay(surface().body, bench.footage(), view, rows=[0, 5]).shape == (360, 960, 3)
    with pytest.raises(VisionError, match=r"bench has no frame 30; it has 0 .. 29"):
        overlay(surface().body, bench.footage(), view, rows=[30])


def test_a_delay_shifts_the_robot_not_the_frame(bench: Bench) -> None:
    view = View.from_camera(TRUTH)
    late = overlay(surface().body, bench.footage(), view, rows=[6], delay=1.0)
    before = draw_outlines(bench.frames[6], surface().body, surface().poses(bench.angles)[5], view)
    apart = pixels(late, OUTLINE) != pixels(before, OUTLINE)
    assert apart.mean() < 0.001


def test_marks_and_what_is_seen_are_crosses(bench: Bench) -> None:
    marks = marks_of(TRUTH, bench.angles, 3, sd=4.0)
    picture = draw_marks(np.zeros((360, 480, 3), np.uint8), marks, View.from_camera(TRUTH))
    assert pixels(picture, MARK).sum() >= 17 and pixels(picture, SEEN).sum() >= 17


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    picture[..., 0] = 200
    save_picture(picture, tmp_path / "a.png")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png"))[..., ::-1], picture)
    with pytest.raises(VisionError, match=r"'.nonsense' is not an image format; use .png"):
        save_picture(picture, tmp_path / "a.nonsense")
    with pytest.raises(VisionError, match="cannot be written: No such file"):
        save_picture(picture, tmp_path / "none" / "a.png")
