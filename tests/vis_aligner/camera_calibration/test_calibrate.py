"""Whole calibrations of cameras whose truth is known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.vis_aligner.camera_calibration import CameraFit, calibrate_camera
from embodiedreamer_gym.vis_aligner.camera_calibration import calibrate as calibrating
from embodiedreamer_gym.vis_aligner.camera_calibration import search as searching
from tests.vis_aligner.camera_calibration.conftest import (
    CENTRE,
    SIZE,
    TRUTH,
    Bench,
    apart,
    film,
    marks_of,
    motion,
    surface,
)

MOVED = TRUTH.with_(position=(1.15, 1.0, 1.4), rotation=look_at((1.15, 1.0, 1.4), np.add(CENTRE, 0.03).tolist()))


@pytest.fixture(scope="module")
def found(bench: Bench) -> CameraFit:
    return calibrate_camera(surface().body, [bench.footage()], name="head", seed=1)


def test_a_camera_is_found_from_nothing(found: CameraFit) -> None:
    assert apart(found.camera, TRUTH, motion()) < 1.0
    np.testing.assert_allclose(found.camera.position, TRUTH.position, atol=0.05)
    assert found.camera.fx == pytest.approx(TRUTH.fx, rel=0.05) and found.camera.name == "head"
    station = found.stations[0]
    assert station.outline < 0.7 and station.found > 0.7 and station.score > 0.7 and station.frames == 24
    assert 0.0 < station.picture_sd < 0.5 and found.doubtful == ()


def test_the_same_seed_finds_the_same(found: CameraFit, bench: Bench, near: Camera) -> None:
    first, second = (calibrate_camera(surface().body, [bench.footage()], start=near) for _ in range(2))
    assert first.as_dict() == second.as_dict()
    assert apart(first.camera, found.camera, motion()) < 0.3  # and from a first guess much the same


def test_what_was_found_can_be_read_and_kept(found: CameraFit) -> None:
    text = str(found)
    assert "lens at 240 x 180: fx 2" in text and "head" in text and "focal ±" in text
    data = json.loads(json.dumps(found.as_dict()))
    assert data["stands"][0]["camera"]["name"] == "head" and data["fitted"] == ["focal", "aspect"]


def test_masks_and_another_gripper_do_as_well(bench: Bench, near: Camera) -> None:
    """Masks that somebody drew, with a box where the gripper's fingers are."""
    masks = bench.masks.copy()
    loose = [name for name in surface().body.names if "finger" in name or "gripper" in name or "link6" in name]
    fit = calibrate_camera(surface().body, [bench.footage(masks=masks)], start=near, loose=loose)
    assert apart(fit.camera, TRUTH, motion()) < 1.0 and fit.stations[0].overlap > 0.9


def test_marks_of_the_robot_take_the_place_of_a_search(bench: Bench) -> None:
    marks = marks_of(TRUTH, bench.angles, 8, sd=1.5)
    fit = calibrate_camera(surface().body, [bench.footage()], marks=marks)
    assert apart(fit.camera, TRUTH, motion()) < 1.0 and fit.stations[0].marks < 4.0


def test_a_camera_that_was_moved_has_two_poses_and_one_lens(bench: Bench, near: Camera) -> None:
    angles = motion(1)
    frames, _ = film(MOVED, angles, seed=1)
    moved = bench.footage(frames=frames, poses=surface().poses(angles), name="moved")
    fit = calibrate_camera(surface().body, [bench.footage(), moved], start=near, name="c")
    assert [camera.name for camera in fit.cameras] == ["c/bench", "c/moved"]
    assert fit.cameras[0].fx == fit.cameras[1].fx
    for camera, truth in zip(fit.cameras, (TRUTH, MOVED), strict=True):
        assert apart(camera, truth, angles) < 1.0


def test_a_fixed_camera_has_one_pose_for_all(bench: Bench, near: Camera) -> None:
    angles = motion(2)
    frames, _ = film(TRUTH, angles, seed=2)
    more = bench.footage(frames=frames, poses=surface().poses(angles), name="more")
    fit = calibrate_camera(surface().body, [bench.footage(), more], start=near, fixed=True)
    assert apart(fit.camera, TRUTH, motion()) < 0.7 and fit.stations[0].frames == 48


def test_pictures_of_any_size(near: Camera) -> None:
    small = TRUTH.with_(size=(128, 96), fx=TRUTH.fx * 128 / 240, fy=TRUTH.fy * 96 / 180, cx=63.5, cy=47.5)
    angles = motion(rows=16)
    frames, _ = film(small, angles)
    from embodiedreamer_gym.vis_aligner.camera_calibration import Footage

    fit = calibrate_camera(surface().body, [Footage(frames, surface().poses(angles))], start=near)
    assert fit.camera.size == (128, 96) and apart(fit.camera, small, angles) < 0.7


def test_without_a_robot_in_view_there_is_no_camera(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames in which everything moves, but not as the joints do: no camera is better than a wrong one."""
    for module, name, count in ((searching, "TRIED", 64), (calibrating, "TRIED", 2), (calibrating, "ADJUSTED", 1)):
        monkeypatch.setattr(module, name, count)
    noise = np.random.default_rng(0).integers(0, 255, (len(bench.frames), 48, 64, 3)).astype(np.uint8)
    with pytest.raises(VisionError, match=r"robot is not recognised .* \(score 0.[012]\d, at least 0.3 is needed\)"):
        calibrate_camera(surface().body, [bench.footage(frames=noise)])


def test_wrong_arguments_are_named(bench: Bench, near: Camera) -> None:
    body, footage = surface().body, bench.footage()
    with pytest.raises(VisionError, match="there is no footage"):
        calibrate_camera(body, [])
    with pytest.raises(VisionError, match="'zoom' cannot be fitted"):
        calibrate_camera(body, [footage], free=("zoom",))
    with pytest.raises(VisionError, match="no visible link 'hand'"):
        calibrate_camera(body, [footage], loose=("hand",))
    marks = marks_of(TRUTH, bench.angles, 4)
    marks.station[:] = 1
    with pytest.raises(VisionError, match=r"a mark belongs to station 1, but stations are 0 .. 0"):
        calibrate_camera(body, [footage], marks=marks)
    with pytest.raises(VisionError, match=r"poses must be .T, 27, 4, 4.|poses must be"):
        calibrate_camera(body, [bench.footage(poses=footage.poses[:, :3])])
    assert footage.size == SIZE
