"""Marks, and the views and cameras that they alone give."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.camera_calibration import Keypoints, View, fit_keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import initial_views
from tests.vis_aligner.camera_calibration.conftest import SIZE, TRUTH, apart, marks_of, motion


def test_exact_marks_give_the_exact_camera() -> None:
    fit = fit_keypoints(marks_of(TRUTH, motion()), SIZE, name="head")
    camera = fit.camera
    assert camera.name == "head" and camera.size == SIZE
    np.testing.assert_allclose(camera.position, TRUTH.position, atol=2e-3)
    assert camera.fx == pytest.approx(TRUTH.fx, rel=2e-3) and camera.fy == pytest.approx(TRUTH.fy, rel=2e-3)
    assert fit.stations[0].marks == pytest.approx(0.0, abs=0.01) and fit.stations[0].outline is None


def test_the_first_views_are_near() -> None:
    marks = marks_of(TRUTH, motion())
    (view,) = initial_views(marks, 1, SIZE)
    assert np.median(marks.errors([view])) < 5.0


@pytest.mark.parametrize("seed", range(3))
def test_a_shaking_hand_moves_the_camera_no_more_than_it_says(seed: int) -> None:
    fit = fit_keypoints(marks_of(TRUTH, motion(), 24, sd=1.0, seed=seed), SIZE)
    station = fit.stations[0]
    assert apart(fit.camera, TRUTH, motion()) < 2.0
    assert np.linalg.norm(np.subtract(fit.camera.position, TRUTH.position)) < 4 * station.position_sd
    assert 0.2 < station.picture_sd < 2.0 and 0 < fit.sd["focal"] < 40.0


def test_one_gross_mistake_is_outvoted() -> None:
    marks = marks_of(TRUTH, motion(), 16, sd=0.3)
    pixel = marks.pixel.copy()
    pixel[3] += 60.0
    fit = fit_keypoints(Keypoints(marks.station, marks.point, pixel, marks.sd), SIZE)
    assert apart(fit.camera, TRUTH, motion()) < 1.5


def test_two_stands_share_a_lens() -> None:
    other = TRUTH.with_(position=(1.35, 0.75, 1.5))
    first, second = marks_of(TRUTH, motion(), 8), marks_of(other, motion(), 8, seed=1)
    marks = Keypoints(
        np.r_[first.station, second.station + 1], np.r_[first.point, second.point], np.r_[first.pixel, second.pixel],
        np.r_[first.sd, second.sd],
    )  # fmt: skip
    fit = fit_keypoints(marks, SIZE, name="c", names=("one", "two"))
    assert [camera.name for camera in fit.cameras] == ["c/one", "c/two"]
    assert fit.cameras[0].fx == fit.cameras[1].fx
    np.testing.assert_allclose(fit.cameras[1].position, other.position, atol=3e-3)
    with pytest.raises(VisionError, match=r"stood in 2 places .c/one, c/two.; use one of fit.cameras"):
        _ = fit.camera


def test_a_start_makes_up_for_missing_marks() -> None:
    marks = marks_of(TRUTH, motion(), 3)
    start = TRUTH.with_(position=tuple(np.add(TRUTH.position, 0.02)))
    fit = fit_keypoints(marks, SIZE, start=start, free=())
    assert fit.stations[0].marks < 0.3 and fit.camera.fx == TRUTH.fx


def test_distortion_can_be_fitted() -> None:
    bent = View.from_camera(TRUTH, k1=-0.15)
    marks = marks_of(TRUTH, motion(), 40)
    marks = Keypoints(marks.station, marks.point, bent.project(marks.point)[:, :2], marks.sd / 50)
    fit = fit_keypoints(marks, SIZE, free=("focal", "k1"))
    assert fit.k1 == pytest.approx(-0.15, abs=0.02)
    frame = np.zeros((180, 240, 3), np.uint8)
    frame[60:62] = 255
    assert fit.undistorted(frame).shape == frame.shape and not np.array_equal(fit.undistorted(frame), frame)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"pixel": np.zeros((4, 3))}, r"4 marks need points .4, 3., pixels .4, 2. and sd .4,."),
        ({"sd": np.zeros(4)}, "standard deviations above 0"),
        ({"point": np.full((4, 3), np.inf)}, "marks must be finite"),
        ({"station": [0, 0, -1, 0]}, "stations of marks count from 0"),
    ],
)
def test_what_is_no_mark_is_refused(change: dict, sentence: str) -> None:
    good = {"station": np.zeros(4), "point": np.zeros((4, 3)), "pixel": np.zeros((4, 2)), "sd": np.ones(4)}
    with pytest.raises(VisionError, match=sentence):
        Keypoints(**{**good, **change})


def test_too_few_marks_and_wrong_choices_are_named() -> None:
    marks = marks_of(TRUTH, motion(), 3)
    with pytest.raises(VisionError, match="station 0 of the camera has 3 marks; without a start at least 4"):
        fit_keypoints(marks, SIZE)
    with pytest.raises(VisionError, match="'fx' cannot be fitted; the parameters are focal, aspect"):
        fit_keypoints(marks, SIZE, free=("fx",))
    with pytest.raises(VisionError, match="marks alone do not show a delay"):
        fit_keypoints(marks, SIZE, free=("delay",))
    with pytest.raises(VisionError, match="marks belong to 0 stations"):
        fit_keypoints(marks.of(np.zeros(3, bool)), SIZE)
    line = Keypoints(np.zeros(5), np.zeros((5, 3)), np.zeros((5, 2)), np.ones(5))
    with pytest.raises(VisionError, match="no camera sees the marks like this"):
        fit_keypoints(line, SIZE)
