"""Convex hulls of the robot's links and the props, which cast shadows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.geometry.hull import POINTS, hull_points
from embodiedreamer_gym.geometry.mesh import surface_of_revolution
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.surface import Surface


def part_hulls(model: RobotModel, props: Sequence[Prop], names: Sequence[str],
               origins: Mapping[str, Sequence[float]] | None = None) -> np.ndarray:  # fmt: skip
    """Hulls (L, 48, 3) float32, m, of links and props by name, each in its own frame; all zero for a link without a shape.

    origins: prop -> origin of the frame of its hull, m in the prop's own frame.
    """
    body, placed = Surface.of_model(model, skeleton=True).body, origins or {}
    found = np.zeros((len(names), POINTS, 3), np.float32)
    for number, name in enumerate(body.names):
        if name in names:
            found[names.index(name)] = hull_points(body.vertices[body.part == number])
    for prop in props:
        vertices = np.concatenate([_vertices(shape) for shape in prop.shapes])
        found[names.index(prop.name)] = hull_points(vertices - np.asarray(placed.get(prop.name, (0.0, 0.0, 0.0))))
    return found


def _vertices(shape: Shape) -> np.ndarray:
    """Corners (V, 3), m, of a shape in its prop's frame."""
    if shape.kind == "box":
        points = np.stack(np.meshgrid(*([(-0.5, 0.5)] * 3)), -1).reshape(-1, 3) * np.asarray(shape.size)
    else:
        points, _ = surface_of_revolution(shape.outline)
    return points @ Rotation.from_euler("xyz", shape.rpy).as_matrix().T + shape.position
