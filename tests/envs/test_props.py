"""Shapes and props: closed meshes of the right size, and URDFs with the inertia of their box."""

from __future__ import annotations

from collections import Counter
from xml.etree import ElementTree

import numpy as np
import pytest

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import EDGES, MARGIN, Shape, beaker, frustum, open_box, staves
from embodiedreamer_gym.envs.tasks import TASKS

PROPS = {prop.name: prop for task in TASKS.values() for prop in task().props}


def read(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 3) and triangles (m, 3) of a mesh."""
    rows = [line.split() for line in shape.mesh().splitlines()]
    points = np.array([list(map(float, row[1:])) for row in rows if row[0] == "v"])
    return points, np.array([list(map(int, row[1:])) for row in rows if row[0] == "f"]) - 1


def volume(shape: Shape) -> float:
    """Of a closed mesh whose faces are seen from outside, m^3."""
    points, faces = read(shape)
    a, b, c = points[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    "shape", [frustum(0.02, 0.03, 0.05), beaker(0.02, 0.03, 0.05, 0.002), frustum(0.01, 0.001, 0.02)]
)
def test_a_turned_shape_is_closed(shape: Shape) -> None:
    points, faces = read(shape)
    place = {i: tuple(np.round(point, 12)) for i, point in enumerate(points)}  # points on the axis coincide
    edges = Counter((place[f[i]], place[f[(i + 1) % 3]]) for f in faces for i in range(3))
    assert all(edges[(b, a)] == count for (a, b), count in edges.items())


def test_the_volume_of_turned_shapes() -> None:
    share = EDGES / (2 * np.pi) * np.sin(2 * np.pi / EDGES)  # of a circle that the polygon fills
    solid = np.pi / 3 * 0.05 * (0.02**2 + 0.02 * 0.03 + 0.03**2) * share
    assert volume(frustum(0.02, 0.03, 0.05)) == pytest.approx(solid)
    assert 0.0 < volume(beaker(0.02, 0.03, 0.05, 0.002)) < 0.25 * solid


def test_what_touches_ends_where_the_shape_does() -> None:
    """PyBullet adds its margin around a mesh, not around a box."""
    points, _ = read(frustum(0.02, 0.03, 0.05).core)
    assert np.abs(points[:, 2] - [[0.025]]).max() == pytest.approx(0.025 - MARGIN)
    assert np.hypot(*points[:, :2].T).max() == pytest.approx(0.03 - MARGIN)
    box = Shape("box", (0.1, 0.1, 0.1))
    assert box.core == box


def test_staves_and_walls_leave_the_inside_free() -> None:
    for stave in staves(0.04, 0.1, 0.003):
        assert np.hypot(*stave.position[:2]) - 0.0015 == pytest.approx(0.037)
        assert stave.position[2] == 0.05
    floor, *walls = open_box(0.22, 0.16, 0.07, 0.003)
    assert floor.size == (0.22, 0.16, 0.003) and len(walls) == 4
    for wall in walls:
        top = wall.position[2] + wall.size[2] / 2
        assert top == pytest.approx(0.07) and wall.position[2] - wall.size[2] / 2 == pytest.approx(0.003)


@pytest.mark.parametrize("name", PROPS)
def test_a_prop_as_files(name: str) -> None:
    prop: Prop = PROPS[name]
    files = prop.files()
    root = ElementTree.fromstring(files[f"{name}.urdf"])
    meshes = {mesh.get("filename") for mesh in root.iter("mesh")}
    assert meshes == set(files) - {f"{name}.urdf"}
    materials = [material.get("name") for material in root.iter("material")]
    assert len(materials) == len(set(materials)) == len(prop.shapes)
    inertia = root.find("link/inertial/inertia")
    assert inertia is not None
    xx, yy, zz = (float(inertia.get(key, "nan")) for key in ("ixx", "iyy", "izz"))
    assert xx == pytest.approx(prop.mass / 12 * (prop.size[1] ** 2 + prop.size[2] ** 2))
    assert xx + yy >= zz and yy + zz >= xx and xx + zz >= yy
