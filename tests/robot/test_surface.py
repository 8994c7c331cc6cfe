"""Surfaces: the shapes of a URDF, and where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet
import pytest
import trimesh
import yourdfpy
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.errors import ModelError, VisionError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.surface import Surface

ARM = """<robot name="arm">
 <link name="base"><visual><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.05" length="0.1"/></geometry></visual></link>
 <link name="upper"><visual><geometry>{shape}</geometry></visual></link>
 <link name="hand"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
 <link name="finger"><visual><geometry><box size="0.01 0.02 0.03"/></geometry></visual></link>
 <link name="tip"/>
 <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 0 2"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
 <joint name="slide" type="prismatic"><parent link="upper"/><child link="hand"/><origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
 <joint name="second" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="slide" multiplier="0.5" offset="0.01"/></joint>
 <joint name="end" type="fixed"><parent link="finger"/><child link="tip"/></joint>
</robot>"""
BOX = '<box size="0.2 0.04 0.04"/>'


def write(folder: Path, shape: str = BOX) -> Path:
    path = folder / "arm.urdf"
    path.write_text(ARM.format(shape=shape))
    return path


def test_links_move_as_their_joints_say(tmp_path: Path) -> None:
    surface = Surface(write(tmp_path), ["turn", "slide"])
    # what collides stands in for the hand; tip is bare
    assert surface.body.names == ("base", "upper", "hand", "finger")
    poses = surface.poses(np.array([[0.0, 0.0], [np.pi / 2, 0.3]]))
    assert poses.shape == (2, 4, 4, 4)
    np.testing.assert_allclose(poses[0, 2, :3, 3], [0.2, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(poses[1, 2, :3, 3], [0, 0.5, 0.1], atol=1e-12)
    np.testing.assert_allclose(poses[1, 3, :3, 3], [-0.16, 0.5, 0.1], atol=1e-12)  # follows by 0.5 x 0.3 + 0.01


def test_points_lie_on_the_shapes(tmp_path: Path) -> None:
    surface = Surface(write(tmp_path), ["turn", "slide"])
    points = surface.points(np.array([[np.pi / 2, 0.0]]))
    body = surface.body
    upper = points[0, body.part == body.names.index("upper")]
    np.testing.assert_allclose(upper.min(axis=0), [-0.02, -0.1, 0.08], atol=1e-6)
    base = points[0, body.part == 0]
    np.testing.assert_allclose([base[:, 2].min(), base[:, 2].max(), base[:, 0].max()], [0, 0.1, 0.05], atol=1e-6)


def test_a_point_of_a_link_is_found(tmp_path: Path) -> None:
    surface = Surface(write(tmp_path), ["turn", "slide"])
    found = surface.locate("hand", np.array([[0.0, 0.1, 0.0]] * 2), np.array([[0.0, 0.0], [np.pi / 2, 0.3]]))
    np.testing.assert_allclose(found, [[0.2, 0.1, 0.1], [-0.1, 0.5, 0.1]], atol=1e-12)


def test_joints_left_out_stay_at_zero(tmp_path: Path) -> None:
    poses = Surface(write(tmp_path), ["turn"]).poses(np.zeros((1, 1)))
    np.testing.assert_allclose(poses[0, 3, :3, 3], [0.2, 0, 0.1], atol=1e-12)


def test_a_gripper_from_0_to_1_is_scaled() -> None:
    surface = Surface.of_model(RobotModel.load("aloha"))
    angles = np.zeros((2, 14))
    angles[1, 6] = 1.0
    shut, open_ = surface.poses(angles)
    moved = np.linalg.norm(open_[:, :3, 3] - shut[:, :3, 3], axis=1)
    names = [name for name, way in zip(surface.body.names, moved, strict=True) if way > 1e-9]
    assert len(names) == 2 and all("left" in name for name in names)
    np.testing.assert_allclose(moved[moved > 1e-9], 0.035)


def test_another_kinematics_agrees() -> None:
    model = RobotModel.load("aloha")
    surface = Surface.of_model(model)
    angles = np.random.default_rng(0).uniform(-1, 1, (5, 14)) * np.r_[np.ones(6), 0, np.ones(6), 0]
    urdf = yourdfpy.URDF.load(str(model.urdf), load_meshes=False)
    for row, poses in zip(angles, surface.poses(angles), strict=True):
        urdf.update_cfg(dict(zip(model.joints, row, strict=True)))
        for name, pose in zip(surface.body.names, poses, strict=True):
            np.testing.assert_allclose(pose, urdf.get_transform(name), rtol=0, atol=1e-12)


def test_meshes_are_read_as_pybullet_reads_them(tmp_path: Path) -> None:
    """A mesh named with package://, scaled and displaced; a ray from the side meets it where a vertex is."""
    ball = trimesh.creation.icosphere(2, 1.0)
    (tmp_path / "meshes").mkdir()
    ball.export(tmp_path / "meshes" / "ball.stl")
    surface = Surface(write(tmp_path, '<mesh filename="package://meshes/ball.stl" scale="0.1 0.1 0.2"/>'), ["turn"])
    upper = surface.body.vertices[surface.body.part == 1]
    np.testing.assert_allclose(np.ptp(upper, axis=0), [0.2, 0.2, 0.4], atol=2e-3)
    client = BulletClient(pybullet.DIRECT)
    shape = client.createCollisionShape(pybullet.GEOM_MESH, fileName=str(tmp_path / "meshes" / "ball.stl"), meshScale=(0.1, 0.1, 0.2))  # fmt: skip
    client.createMultiBody(0, shape, basePosition=(0, 0, 0.1))
    hit = client.rayTest((1, 0, 0.1), (-1, 0, 0.1))[0][3]
    client.disconnect()
    assert hit[0] == pytest.approx(upper[:, 0].max(), abs=2e-3)


@pytest.mark.parametrize(
    ("shape", "sentence"),
    [
        ('<mesh filename="package://meshes/none.stl"/>', "mesh package://meshes/none.stl of link 'upper' is missing"),
        ('<mesh filename="broken.obj"/>', "mesh broken.obj of link 'upper' (cannot be read|holds no triangle)"),
    ],
)
def test_a_mesh_that_cannot_be_read_is_named(tmp_path: Path, shape: str, sentence: str) -> None:
    (tmp_path / "broken.obj").write_text("this is no mesh")
    with pytest.raises(ModelError, match=sentence):
        Surface(write(tmp_path, shape), ["turn"])


def test_a_robot_without_shapes_cannot_be_seen(tmp_path: Path) -> None:
    path = tmp_path / "bare.urdf"
    path.write_text('<robot name="bare"><link name="base"/></robot>')
    with pytest.raises(ModelError, match=r"bare.urdf gives no link a shape"):
        Surface(path, [])


@pytest.mark.parametrize(
    ("joints", "sentence"),
    [
        (["turn", "twist"], "joint 'twist' is not a movable joint of arm.urdf; movable: turn, slide, second"),
        (["turn", "turn"], "a joint is named twice"),
    ],
)
def test_wrong_joints_are_named(tmp_path: Path, joints: list[str], sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        Surface(write(tmp_path), joints)


def test_wrong_angles_and_points_are_named(tmp_path: Path) -> None:
    surface = Surface(write(tmp_path), ["turn", "slide"])
    with pytest.raises(ModelError, match=r"must be .T, 2.: one column for each of turn, slide"):
        surface.poses(np.zeros((5, 3)))
    with pytest.raises(ModelError, match="row 1 are not finite"):
        surface.poses(np.array([[0, 0], [np.nan, 0]]))
    with pytest.raises(ModelError, match="no visible link 'tip'; it has base, upper"):
        surface.locate("tip", np.zeros((1, 3)), np.zeros((1, 2)))
    with pytest.raises(ModelError, match=r"1 rows of angles need points .1, 3."):
        surface.locate("base", np.zeros((2, 3)), np.zeros((1, 2)))
    with pytest.raises(VisionError, match="no visible link 'thumb'"):
        surface.body.chosen(["thumb"])
