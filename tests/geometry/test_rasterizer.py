"""Triangles drawn into a grid."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.geometry.rasterizer import draw_parts

FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def square(left: float, top: float, right: float, bottom: float, depth: float) -> np.ndarray:
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return np.array([(x, y, depth) for x, y in corners], np.float32)


def test_a_cell_is_covered_when_its_middle_is() -> None:
    code, depth = draw_parts(square(1.5, 0.6, 4.4, 2.0, 2.0)[None], FACES, np.zeros(4, np.int32), (6, 4))
    expected = np.zeros((4, 6), np.uint8)
    expected[1:3, 2:5] = 1
    np.testing.assert_array_equal(code[0], expected)
    np.testing.assert_allclose(depth[0], 2.0 * expected)


def test_either_winding_is_drawn() -> None:
    points = square(0.5, 0.5, 2.5, 2.5, 1.0)[None]
    one, other = (draw_parts(points, f, np.zeros(4, np.int32), (4, 4))[0] for f in (FACES, FACES[:, ::-1].copy()))
    np.testing.assert_array_equal(one, other)
    assert one.sum() == 4


def test_the_nearer_part_is_seen() -> None:
    points = np.concatenate([square(0, 0, 9, 9, 2.0), square(3, 3, 5, 5, 1.0)])[None]
    faces, part = np.concatenate([FACES, FACES + 4]), np.repeat([0, 1], 4).astype(np.int32)
    for order in (slice(None), slice(None, None, -1)):
        code, depth = draw_parts(points, faces[order].copy(), part, (10, 10))
        assert code[0, 4, 4] == 2 and depth[0, 4, 4] == 1.0 and code[0, 8, 8] == 1


def test_depth_between_corners_is_that_of_the_plane() -> None:
    """Inverse depth is linear in the picture."""
    points = np.array([[(0, 0, 1.0), (10, 0, 3.0), (10, 10, 3.0), (0, 10, 1.0)]], np.float32)
    depth = draw_parts(points, FACES, np.zeros(4, np.int32), (11, 11))[1]
    np.testing.assert_allclose(depth[0, 5, 5], 1.0 / (0.5 / 1.0 + 0.5 / 3.0), rtol=1e-5)


def test_what_reaches_behind_the_camera_or_outside_is_left_out() -> None:
    for points in (square(0, 0, 9, 9, -1.0), square(20, 0, 29, 9, 1.0), square(3, 3, 3, 3, 1.0)):
        assert not draw_parts(points[None], FACES, np.zeros(4, np.int32), (10, 10))[0].any()


def test_pictures_of_one_call_are_independent() -> None:
    points = np.stack([square(0, 0, 3, 3, 1.0), square(4, 4, 8, 8, 1.0)])
    code = draw_parts(points, FACES, np.zeros(4, np.int32), (9, 9))[0]
    assert code[0, 1, 1] and not code[0, 6, 6] and code[1, 6, 6] and not code[1, 1, 1]
