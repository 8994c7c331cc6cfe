"""Footage: what is looked at, and what is wrong with it in one sentence."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import (
    Footage,
    bounding_sphere,
    observe,
    spread,
    working_size,
)
from tests.vis_aligner.camera_calibration.conftest import SIZE, Bench, motion, surface


def test_chosen_rows_differ() -> None:
    places = np.zeros((20, 1, 3))
    places[:, 0, 0] = np.r_[np.zeros(10), np.linspace(0, 1, 10)]
    assert spread(places, 3, np.ones(20)).tolist() == [0, 14, 19] or spread(places, 3, np.ones(20))[2] == 19
    assert len(spread(places, 50, np.ones(20))) == 10  # no two alike


def test_calm_rows_are_preferred() -> None:
    places = np.random.default_rng(0).normal(size=(40, 2, 3))
    calm = np.where(np.arange(40) % 2, 1.0, 0.05)
    assert (spread(places, 8, calm) % 2 == 1).all()


def test_a_scene_sees_the_robot_where_it_is(bench: Bench) -> None:
    scene = observe(bench.footage(), surface().body, SIZE)
    assert scene.size == SIZE and len(scene.rows) == len(scene.foreground) == 24 and len(scene.few) == 12
    found, true = scene.foreground > 0.5, bench.masks[scene.rows]
    moving = true.any(axis=0) & ~true.all(axis=0)
    assert (found & true & moving).sum() > 0.5 * (true & moving).sum()
    assert (found & ~true).sum() < 0.1 * found.sum()


def test_masks_take_the_place_of_motion(bench: Bench) -> None:
    scene = observe(bench.footage(masks=bench.masks), surface().body, SIZE)
    found, true = scene.foreground > 0.5, bench.masks[scene.rows]
    assert (found & true).sum() > 0.97 * (found | true).sum()


def test_velocities_are_those_of_the_points(bench: Bench) -> None:
    footage = bench.footage()
    scene = observe(footage, surface().body, SIZE)
    body = surface().body
    late = scene.vertices(body, delay=0.1)
    k = int(np.flatnonzero((scene.rows > 0) & (scene.rows < len(footage.poses) - 1))[0])
    row = scene.rows[k]
    before, after = body.at(footage.poses[[row - 1, row + 1]])
    expected = -0.1 * (after - before) / 2
    np.testing.assert_allclose(late[k] - scene.vertices(body)[k], expected, atol=1e-5)


def test_pictures_are_fitted_in_a_middling_size() -> None:
    assert working_size((1280, 720)) == (384, 216)
    assert working_size((320, 192)) == (320, 192)
    assert working_size((128, 96)) == (240, 180)


def test_the_extent_is_that_of_what_moves() -> None:
    middle, radius = bounding_sphere(surface().body, surface().poses(motion()))
    assert np.linalg.norm(middle - (0.45, 0.3, 0.95)) < 0.25 and 0.15 < radius < 0.6


def changed(poses: np.ndarray, value: float) -> np.ndarray:
    poses = poses.copy()
    poses[7, 3, 0, 3] = value
    return poses


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda f: {"poses": f.poses[:, 0]}, r"poses must be .T, P, 4, 4."),
        (lambda f: {"poses": changed(f.poses, np.nan)}, "joint angles of row 7 are not finite"),
        (lambda f: {"poses": f.poses[:20]}, "30 frames for 20 rows of joint angles"),
        (lambda f: {"masks": np.zeros((3, 180, 240))}, "3 masks for 30 rows"),
        (lambda f: {"frames": f.frames[:4], "poses": f.poses[:4]}, "4 frames are too few; at least 6"),
    ],
)
def test_parts_that_do_not_fit_are_refused(bench: Bench, make, sentence: str) -> None:
    with pytest.raises(VisionError, match=sentence):
        bench.footage(**make(bench.footage()))


def sizes(frames: np.ndarray) -> list[np.ndarray]:
    return [frame if t != 11 else frame[:100] for t, frame in enumerate(frames)]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda f: {"frames": sizes(f.frames)}, "frame 11 is 240 x 100, others 240 x 180; give frames of one size"),
        (lambda f: {"frames": f.frames.astype(float)}, r"frame \d+ is float64 of shape .180, 240, 3., not uint8 RGB"),
        (lambda f: {"frames": np.full_like(f.frames, 90)}, "nothing moves in the pictures, so no robot is visible"),
        (lambda f: {"poses": np.repeat(f.poses[:1], 30, axis=0)}, "the robot does not move"),
        (lambda f: {"masks": np.zeros((30, 180, 240), bool)}, "the masks are empty in the 24 selected frames"),
        (lambda f: {"masks": np.zeros((30, 90, 120), bool)}, r"mask \d+ is bool of shape .90, 120., but must be"),
    ],
)
def test_footage_without_a_moving_robot_is_refused(bench: Bench, make, sentence: str) -> None:
    footage = bench.footage(**make(bench.footage()))
    with pytest.raises(VisionError, match=sentence):
        observe(footage, surface().body, SIZE)


def test_it_says_what_it_is(bench: Bench) -> None:
    assert repr(bench.footage(masks=bench.masks)) == "Footage('bench', 30 frames, masks)"
    assert isinstance(bench.footage(), Footage)


@pytest.mark.parametrize("size", [(48, 4), (4, 48), (20, 300)])
def test_frames_that_are_too_small_or_too_narrow_are_refused(bench: Bench, size: tuple[int, int]) -> None:
    """A narrow picture would be enlarged to one of gigabytes."""
    frames = np.zeros((len(bench.frames), size[1], size[0], 3), np.uint8)
    with pytest.raises(VisionError, match=f"frames are {size[0]} x {size[1]}; both edges must have at least 8 pixels"):
        _ = bench.footage(frames=frames).size


def test_what_are_no_frames_is_named(bench: Bench) -> None:
    for frames in (None, 3):
        with pytest.raises(VisionError, match=f"frames must be pictures, one per row of joint angles, not {frames}"):
            bench.footage(frames=frames)
    with pytest.raises(VisionError, match="joint angles of row 3 are not finite, or too large"):
        poses = bench.footage().poses.copy()
        poses[3, 0, 0, 3] = 1e30
        bench.footage(poses=poses)
