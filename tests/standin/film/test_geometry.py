"""Meshes are closed, seen from outside, and as large as what the simulator draws."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.geometry.mesh import surface_of_revolution
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.film.geometry import (
    ROBOT_CLASS,
    box,
    cylinder,
    prop_parts,
    robot_parts,
    sphere,
    table_part,
)

URDF = """<robot name="one"><link name="base"><visual><origin xyz="0 0 1" rpy="0 0 1.5707963"/>
<geometry>{}</geometry></visual></link></robot>"""
CUP = [(0.0, 0.0), (0.03, 0.0), (0.04, 0.1), (0.038, 0.1), (0.028, 0.004), (0.0, 0.004)]


def volume(points: np.ndarray, faces: list[tuple[int, ...]]) -> float:
    """Of a closed mesh; below 0 where its faces are seen from inside."""
    fans = [(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1)]
    corners = points[np.array(fans)]
    return float(np.linalg.det(corners).sum() / 6.0)


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (box((0.1, 0.2, 0.3)), 0.006),
        (cylinder(0.1, 0.5), np.pi * 0.005),
        (sphere(0.1), 4 / 3 * np.pi * 0.001),
        (surface_of_revolution([(0.0, 0.0), (0.1, 0.0), (0.0, 0.3)]), np.pi * 0.001),
    ],
)
def test_a_shape_is_closed_and_seen_from_outside(mesh, expected: float) -> None:
    points, faces = mesh
    edges = Counter((a, b) for face in faces for a, b in zip(face, (*face[1:], face[0]), strict=True))
    assert all(edges[b, a] == 1 for a, b in edges)
    assert volume(points, faces) == pytest.approx(expected, rel=0.012)
    assert set(np.concatenate(faces).tolist()) == set(range(len(points)))


def test_a_hollow_thing_holds_what_its_walls_leave() -> None:
    thick = volume(*surface_of_revolution(CUP)) / volume(
        *surface_of_revolution([(0.0, 0.0), (0.03, 0.0), (0.04, 0.1), (0.0, 0.1)])
    )
    assert 0.08 < thick < 0.2


def test_the_robots_parts_are_the_urdfs() -> None:
    """Every link that has visuals, in the materials' names; trimmings stand out by 2 mm at most."""
    parts = robot_parts(RobotModel.load("aloha").urdf)
    assert {part.material for part in parts} == {"shell", "housing", "accent", "pad"}
    assert {part.number for part in parts} == {ROBOT_CLASS}
    assert {"left_base", "right_link2", "left_finger2"} <= {part.body for part in parts}
    upper = np.concatenate([part.points for part in parts if part.body == "left_link2"])
    np.testing.assert_allclose(upper.min(axis=0), (0.0175, -0.037, -0.041), atol=0.002)
    np.testing.assert_allclose(upper.max(axis=0), (0.32203, 0.037, 0.041), atol=0.002)


def test_a_props_parts_have_its_size_and_a_paint_for_each_colour() -> None:
    for task in TASKS.values():
        for number, prop in enumerate(task().props, 3):
            parts = prop_parts(prop, number)
            points = np.concatenate([part.points for part in parts])
            np.testing.assert_allclose(np.ptp(points, axis=0), prop.size, rtol=0.03, atol=0.001)
            assert points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
            assert {part.number for part in parts} == {number} and {part.body for part in parts} == {prop.name}
            colours = {shape.rgba or prop.rgba for shape in prop.shapes}
            assert {p.material for p in parts} == {prop.name, *(f"{prop.name}{i}" for i in range(2, len(colours) + 1))}
    assert table_part().points[:, 2].max() == pytest.approx(0.74)


@pytest.mark.parametrize(
    ("shape", "ends"),
    [('<box size="0.2 0.4 0.6"/>', (0.2, 0.1, 1.3)), ('<cylinder radius="0.1" length="0.4"/>', (0.1, 0.1, 1.2)),
     ('<sphere radius="0.3"/>', (0.3, 0.3, 1.3))],
)  # fmt: skip
def test_a_urdfs_shapes_stand_where_their_origin_says(tmp_path: Path, shape: str, ends) -> None:
    path = tmp_path / "one.urdf"
    path.write_text(URDF.format(shape))
    np.testing.assert_allclose(robot_parts(path)[0].points.max(axis=0), ends, atol=0.002)


def test_other_shapes_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "one.urdf"
    path.write_text(URDF.format('<mesh filename="arm.stl"/>'))
    with pytest.raises(ModelError, match=r"link base: a visual is mesh; .* draws box, cylinder, sphere"):
        robot_parts(path)
