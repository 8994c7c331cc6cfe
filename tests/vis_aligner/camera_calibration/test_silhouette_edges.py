"""Outlines: where a view predicts the robot's edge, and where the picture has it."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.geometry.articulated_mesh import Body, DetailLevels
from embodiedreamer_gym.vis_aligner.camera_calibration.motion_mask import smooth
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import find_steps, predict
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

SIZE = (100, 80)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def plates(loose: bool = False) -> tuple[DetailLevels, View, np.ndarray]:
    """Two square plates 1 m before a camera of focal length 100: jacobian_columns 20 to 59, and 60 to 80; rows 20 to 60."""
    first = [(19.5, 19.5), (59.5, 19.5), (59.5, 60.5), (19.5, 60.5)]
    second = [(59.5, 19.5), (80.5, 19.5), (80.5, 60.5), (59.5, 60.5)]
    corners = np.array([((x - 49.5) / 100, (y - 39.5) / 100, 1.0) for x, y in first + second])
    body = Body(corners, np.concatenate([FACES, FACES + 4]), np.repeat([0, 1], 4), ("big", "small"))
    levels = DetailLevels(body, body, body, np.array([False, loose]), 0.05)
    return levels, View.from_pose(np.zeros(3), np.eye(3), 100.0, SIZE), body.vertices[None]


def test_the_outline_is_the_border() -> None:
    levels, view, vertices = plates()
    outline = predict(levels, vertices, view)
    assert len(outline) > 80 and (outline.frame == 0).all()
    x, y = outline.pixel.T
    on = np.minimum.reduce([np.abs(x - 19.5), np.abs(x - 80.5), np.abs(y - 19.5), np.abs(y - 60.5)])
    assert on.max() < 0.3
    left = (np.abs(x - 19.5) < 1) & (np.abs(y - 40) < 15)
    np.testing.assert_allclose(outline.normal[left], [[-1, 0]] * left.sum(), atol=0.05)
    np.testing.assert_allclose(view.project(outline.point)[:, :2], outline.pixel, atol=1e-6)
    np.testing.assert_allclose(outline.point[:, 2], 1.0, atol=1e-5)
    assert set(outline.part[x < 55]) == {0} and set(outline.part[x > 65]) == {1}


def test_near_a_loose_part_there_is_none() -> None:
    outline = predict(*reorder(plates(loose=True)))
    assert len(outline) > 40 and outline.pixel[:, 0].max() < 56.5  # 5 pixels of margin


def reorder(made: tuple[DetailLevels, View, np.ndarray]) -> tuple[DetailLevels, np.ndarray, View]:
    levels, view, vertices = made
    return levels, vertices, view


@pytest.mark.parametrize("shift", [-3, 0, 2])
def test_a_shifted_edge_is_found_at_its_distance(shift: int) -> None:
    levels, view, vertices = plates()
    outline = predict(levels, vertices, view)
    picture = np.zeros((1, SIZE[1], SIZE[0]), np.float32)
    picture[0, 20:61, 20 - shift : 81] = 1.0  # the left edge alone has moved
    distance, strength = find_steps(outline, smooth(picture), 6.0)
    x, y = outline.pixel.T
    left, right = (np.abs(x - 20) < 1) & (np.abs(y - 40) < 12), (np.abs(x - 80) < 1) & (np.abs(y - 40) < 12)
    assert np.median(distance[left]) == pytest.approx(shift, abs=0.3) and strength[left].min() > 0.5
    assert np.abs(np.median(distance[right])) < 0.3


def test_where_nothing_changes_no_edge_is_found() -> None:
    levels, view, vertices = plates()
    outline = predict(levels, vertices, view)
    assert find_steps(outline, np.ones((1, SIZE[1], SIZE[0]), np.float32), 6.0)[1].max() < 1e-3


def test_an_edge_of_the_wrong_side_is_none() -> None:
    """Evidence outside and none inside is no edge of the robot."""
    levels, view, vertices = plates()
    outline = predict(levels, vertices, view)
    picture = np.ones((1, SIZE[1], SIZE[0]), np.float32)
    picture[0, 20:61, 20:81] = 0.0
    assert find_steps(outline, smooth(picture), 3.0)[1].max() < 0.1


def test_nothing_in_the_picture_has_no_outline() -> None:
    levels, view, vertices = plates()
    assert len(predict(levels, vertices + np.float32([5, 0, 0]), view)) == 0
