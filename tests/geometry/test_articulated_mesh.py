"""Bodies: rigid parts placed by poses, in several levels of detail."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.articulated_mesh import Body, DetailLevels


def two_parts() -> Body:
    """A fine ball of radius 0.1 m, and a small box."""
    ball, box = trimesh.creation.icosphere(4, 0.1), trimesh.creation.box((0.01, 0.02, 0.03))
    return Body(
        np.concatenate([ball.vertices, box.vertices]),
        np.concatenate([ball.faces, box.faces + len(ball.vertices)]),
        np.r_[np.zeros(len(ball.vertices)), np.ones(len(box.vertices))],
        ("ball", "box"),
    )


def test_each_part_goes_where_its_pose_puts_it() -> None:
    body = two_parts()
    poses = np.tile(np.eye(4), (2, 2, 1, 1))
    poses[1, 0, :3, 3] = (1.0, 2.0, 3.0)
    poses[1, 1, :3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    placed = body.at(poses)
    ball, box = body.part == 0, body.part == 1
    np.testing.assert_allclose(placed[0], body.vertices)
    np.testing.assert_allclose(placed[1, ball], body.vertices[ball] + (1, 2, 3), atol=1e-6)
    np.testing.assert_allclose(placed[1, box], body.vertices[box][:, [1, 0, 2]] * (-1, 1, 1), atol=1e-7)


def test_a_coarser_body_keeps_its_shape_and_its_boxes() -> None:
    body = two_parts()
    coarse = body.coarser(0.03)
    ball = coarse.vertices[coarse.part == 0]
    assert len(coarse.faces) < 0.2 * len(body.faces)
    assert np.linalg.norm(ball, axis=1).min() > 0.09
    np.testing.assert_array_equal(coarse.vertices[coarse.part == 1], body.vertices[body.part == 1])
    assert (coarse.part[coarse.faces] == coarse.part[coarse.faces[:, :1]]).all()


def test_a_figure_has_levels_and_knows_what_is_loose() -> None:
    figure = DetailLevels.of(two_parts(), 0.3, ["box"], 0.02)
    assert figure.loose.tolist() == [False, True]
    assert len(figure.coarse.faces) < len(figure.middle.faces) < len(figure.fine.faces)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"vertices": np.zeros((3, 2))}, r"vertices .V, 3., faces .F, 3. and part .V,., not .3, 2."),
        ({"faces": np.zeros((0, 3))}, "at least one triangle"),
        ({"vertices": np.full((3, 3), np.nan)}, "finite vertices"),
        ({"faces": [[0, 1, 3]]}, "faces must contain indices of its vertices"),
        ({"part": [0, 0, 2]}, "part indices of its parts"),
        ({"names": tuple(map(str, range(255)))}, "255 parts has too many; at most 254"),
    ],
)
def test_what_is_no_body_is_refused(change: dict, sentence: str) -> None:
    good = {"vertices": np.zeros((3, 3)), "faces": [[0, 1, 2]], "part": np.zeros(3), "names": ("a",)}
    with pytest.raises(VisionError, match=sentence):
        Body(**{**good, **change})


def test_wrong_poses_links_and_margins_are_named() -> None:
    body = two_parts()
    with pytest.raises(VisionError, match=r"poses must be .T, 2, 4, 4., one 4x4 per part, not .5, 3, 4, 4."):
        body.at(np.zeros((5, 3, 4, 4)))
    with pytest.raises(VisionError, match="no visible link 'hand'; it has ball, box"):
        DetailLevels.of(body, 0.3, ["hand"])
    with pytest.raises(VisionError, match="margin around loose links is -1 m"):
        DetailLevels.of(body, 0.3, ["box"], -1)
