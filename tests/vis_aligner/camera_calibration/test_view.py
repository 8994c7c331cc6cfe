"""Views: what they see, how it changes, and how they become cameras."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.vis_aligner.camera_calibration.view import PARAMETERS, View

CAMERA = Camera("c", (1.0, 0.5, 0.8), look_at((1.0, 0.5, 0.8), (0.2, 0, 0.1)), (320, 192), 150.0, 160.0, 155.0, 99.0)
POINTS = np.random.default_rng(0).normal(0.0, 0.2, (6, 3))


def bent(k1: float = -0.12) -> View:
    return View.from_camera(CAMERA, k1=k1)


def test_it_sees_as_opencv_does() -> None:
    view = bent()
    matrix, distortion = CAMERA.matrix(), np.array([-0.12, 0.0, 0.0, 0.0])
    expected, _ = cv2.projectPoints(POINTS, cv2.Rodrigues(view.rotation)[0], view.translation, matrix, distortion)
    seen = view.project(POINTS)
    np.testing.assert_allclose(seen[:, :2], expected[:, 0], atol=1e-9)
    assert (seen[:, 2] > 0).all()


def test_a_view_of_another_size_shows_the_same() -> None:
    """The corners of a picture, half a pixel outside the middles of its outermost pixels, stay corners."""
    small = bent().of_size((160, 64))
    expected = (bent().project(POINTS)[:, :2] + 0.5) * (0.5, 1 / 3) - 0.5
    np.testing.assert_allclose(small.project(POINTS)[:, :2], expected, atol=1e-9)
    np.testing.assert_allclose(small.camera("c").matrix((320, 192)), CAMERA.matrix(), atol=1e-9)


def test_single_precision_stays_single() -> None:
    seen = bent().project(POINTS.astype(np.float32))
    assert seen.dtype == np.float32
    np.testing.assert_allclose(seen[:, :2], bent().project(POINTS)[:, :2], atol=1e-3)


def test_what_is_behind_is_far_outside() -> None:
    position, rotation = CAMERA.pose()
    assert bent().project((position - rotation[:, 2])[None])[0, 0] < -1e4


@pytest.mark.parametrize("k", range(len(PARAMETERS)), ids=PARAMETERS)
def test_slopes_are_the_derivative(k: int) -> None:
    view, step = bent(0.07), np.zeros(len(PARAMETERS))
    step[k] = 1e-6
    expected = (view.updated(step).project(POINTS) - view.updated(-step).project(POINTS))[:, :2] / 2e-6
    np.testing.assert_allclose(view.jacobian(POINTS)[:, :, k], expected, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("k1", [0.0, -0.12, 0.2])
def test_a_place_is_where_the_pixel_came_from(k1: float) -> None:
    view = bent(k1)
    seen = view.project(POINTS)
    np.testing.assert_allclose(view.unproject(seen[:, :2], seen[:, 2]), POINTS, atol=1e-4)


def test_a_camera_and_back() -> None:
    camera = View.from_camera(CAMERA).camera("c")
    np.testing.assert_allclose(camera.position, CAMERA.position)
    np.testing.assert_allclose(np.abs(np.dot(camera.rotation, CAMERA.rotation)), 1.0)
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.size) == (150.0, 160.0, 155.0, 99.0, (320, 192))


def test_another_size_shows_the_same() -> None:
    small, large = (View.from_camera(CAMERA, size) for size in ((320, 192), (640, 384)))
    np.testing.assert_allclose((small.project(POINTS)[:, :2] + 0.5) * 2 - 0.5, large.project(POINTS)[:, :2])


def test_many_changes_leave_a_rotation() -> None:
    view, rng = bent(), np.random.default_rng(1)
    for _ in range(200):
        view = view.updated(np.r_[rng.normal(0.0, 0.3, 3), rng.normal(0.0, 0.1, 3), np.zeros(5)])
    np.testing.assert_allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.rotation) == pytest.approx(1.0)


def test_a_zoom_keeps_the_aspect() -> None:
    change = np.zeros(len(PARAMETERS))
    change[PARAMETERS.index("focal")] = 0.2
    view = bent().updated(change)
    assert view.fx == pytest.approx(150.0 * np.exp(0.2)) and view.aspect == pytest.approx(160.0 / 150.0)
