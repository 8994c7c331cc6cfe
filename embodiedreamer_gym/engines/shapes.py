"""Boxes, cylinders and solids of revolution, of which props consist."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

EDGES = 24  # around a solid of revolution
MARGIN = 0.001  # m that PyBullet adds around a collision mesh

Vector = tuple[float, float, float]
Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class Shape:
    """A box, an upright cylinder or an upright solid of revolution ("turned") in a prop's frame, m.

    size: a box's three edges; a cylinder's radius and length; a turned shape's outline from axis to axis, as pairs of
    radius and height. position: of its centre (of a turned shape, the point at height 0); rpy: its rotation, rad; rgba:
    its colour, None for the prop's. In contacts, a turned shape is its convex hull.
    """

    kind: str
    size: tuple[float, ...]
    position: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    rgba: Colour | None = None

    def urdf(self) -> str:
        """The shape's origin and geometry as URDF elements."""
        origin = f'<origin xyz="{numbers(self.position)}" rpy="{numbers(self.rpy)}"/>'
        if self.kind == "box":
            geometry = f'<box size="{numbers(self.size)}"/>'
        elif self.kind == "cylinder":
            geometry = f'<cylinder radius="{self.size[0]:.9g}" length="{self.size[1]:.9g}"/>'
        else:
            geometry = f'<mesh filename="{self.file}"/>'
        return f"{origin}<geometry>{geometry}</geometry>"

    @property
    def outline(self) -> list[tuple[float, float]]:
        """Radius and height, m, from axis to axis, of a cylinder or turned shape."""
        if self.kind == "cylinder":
            radius, half = self.size[0], self.size[1] / 2
            return [(0.0, -half), (radius, -half), (radius, half), (0.0, half)]
        return list(zip(self.size[::2], self.size[1::2], strict=True))

    @property
    def core(self) -> Shape:
        """The collision shape for PyBullet, smaller by the margin that PyBullet adds around meshes."""
        if self.kind != "turned":
            return self
        radii, heights = np.array(self.size[::2]), np.array(self.size[1::2])
        heights = np.clip(heights, heights.min() + MARGIN, heights.max() - MARGIN)
        outline = np.stack([radii - MARGIN, heights], axis=1)[radii > 0]  # the hull closes itself over the axis
        return replace(self, size=tuple(outline.ravel().tolist()))

    @property
    def file(self) -> str:
        """Name of a turned shape's mesh."""
        return "turned-" + "-".join(f"{1e6 * x:.0f}" for x in self.size) + ".obj"

    def corners(self) -> np.ndarray:
        """Points (k, 3), m in the prop's frame, with the same convex hull as the shape."""
        if self.kind == "box":
            points = 0.5 * np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * self.size
        else:
            angles = np.arange(EDGES) * 2 * np.pi / EDGES
            rings = [(r * np.cos(angles), r * np.sin(angles), np.full(EDGES, z)) for r, z in self.outline if r > 0]
            points = np.concatenate([np.stack(ring, axis=1) for ring in rings])
        return points @ Rotation.from_euler("xyz", self.rpy).as_matrix().T + self.position

    def mesh(self) -> str:
        """A turned shape as Wavefront OBJ, with faces oriented outwards."""
        outline = list(zip(self.size[::2], self.size[1::2], strict=True))
        angles = np.arange(EDGES) * 2 * np.pi / EDGES
        rows = [(r * np.cos(a), r * np.sin(a), z) for r, z in outline for a in angles]
        faces = []
        for ring in range(len(outline) - 1):
            for i in range(EDGES):
                low, after = ring * EDGES + i + 1, ring * EDGES + (i + 1) % EDGES + 1
                if outline[ring][0] > 0:
                    faces.append((low, after, after + EDGES))
                if outline[ring + 1][0] > 0:
                    faces.append((low, after + EDGES, low + EDGES))
        lines = [f"v {numbers(row)}" for row in rows] + ["f " + " ".join(map(str, face)) for face in faces]
        return "\n".join(lines) + "\n"


def frustum(bottom: float, top: float, length: float, **fields) -> Shape:
    """A truncated cone on its bottom face: radii and length, m."""
    return Shape("turned", (0.0, 0.0, bottom, 0.0, top, length, 0.0, length), **fields)


def beaker(bottom: float, top: float, height: float, wall: float, **fields) -> Shape:
    """A cup: outer radii, height and thickness of wall and bottom, m."""
    inside = (top - wall, height, bottom - wall, wall, 0.0, wall)
    return Shape("turned", (0.0, 0.0, bottom, 0.0, top, height, *inside), **fields)


def staves(radius: float, height: float, wall: float, count: int = 12) -> tuple[Shape, ...]:
    """Flat pieces of an upright round wall with an outer radius, m: collision shapes of a hollow object."""
    width = 2 * radius * np.tan(np.pi / count)
    pieces = []
    for angle in np.arange(count) * 2 * np.pi / count:
        place = ((radius - wall / 2) * np.cos(angle), (radius - wall / 2) * np.sin(angle), height / 2)
        pieces.append(Shape("box", (wall, width, height), place, (0.0, 0.0, float(angle))))
    return tuple(pieces)


def open_box(depth: float, width: float, height: float, wall: float) -> tuple[Shape, ...]:
    """Floor and four walls of a box without a lid; outer edges, m."""
    x, y, z, rise = (depth - wall) / 2, (width - wall) / 2, (height + wall) / 2, height - wall
    return (
        Shape("box", (depth, width, wall), (0.0, 0.0, wall / 2)),
        *(Shape("box", (wall, width, rise), (s * x, 0.0, z)) for s in (-1.0, 1.0)),
        *(Shape("box", (depth - 2 * wall, wall, rise), (0.0, s * y, z)) for s in (-1.0, 1.0)),
    )


def numbers(values: Iterable[float]) -> str:
    """Numbers as text for URDF and OBJ files."""
    return " ".join(f"{v:.9g}" for v in values)
