"""Things on the table, built of boxes, cylinders and frustums."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

EDGES = 24  # of a frustum
MARGIN = 0.001  # m that PyBullet adds around a mesh that touches

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Shape:
    """A box (size: its three edges, m), or an upright cylinder (radius, length) or frustum (bottom radius, top radius,
    length), in a prop's frame: position of its centre, m, and how it is turned.
    """

    kind: str
    size: tuple[float, ...]
    position: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def urdf(self) -> str:
        """The shape's origin and geometry."""
        origin = f'<origin xyz="{_numbers(self.position)}" rpy="{_numbers(self.rpy)}"/>'
        if self.kind == "box":
            return f'{origin}<geometry><box size="{_numbers(self.size)}"/></geometry>'
        if self.kind == "frustum":
            return f'{origin}<geometry><mesh filename="{self.file}"/></geometry>'
        return f'{origin}<geometry><cylinder radius="{self.size[0]:.9g}" length="{self.size[1]:.9g}"/></geometry>'

    @property
    def core(self) -> Shape:
        """What PyBullet is to get, so that the shape touches where it ends."""
        if self.kind != "frustum":
            return self
        bottom, top, height = self.size
        return replace(self, size=(bottom - MARGIN, top - MARGIN, height - 2 * MARGIN))

    @property
    def file(self) -> str:
        """Name of a frustum's mesh."""
        return "frustum-" + "-".join(f"{1e6 * x:.0f}" for x in self.size) + ".obj"

    def mesh(self) -> str:
        """A frustum as Wavefront OBJ."""
        bottom, top, height = self.size
        angles = np.arange(EDGES) * 2 * np.pi / EDGES
        rows = [
            (r * np.cos(a), r * np.sin(a), z) for r, z in ((bottom, -height / 2), (top, height / 2)) for a in angles
        ]
        after = [(i + 1) % EDGES for i in range(EDGES)]
        faces = [(i + 1, after[i] + 1, EDGES + after[i] + 1) for i in range(EDGES)]
        faces += [(i + 1, EDGES + after[i] + 1, EDGES + i + 1) for i in range(EDGES)]
        for i in range(1, EDGES - 1):
            faces += [(1, i + 2, i + 1), (EDGES + 1, EDGES + i + 1, EDGES + i + 2)]
        lines = [f"v {_numbers(row)}" for row in rows] + ["f " + " ".join(map(str, face)) for face in faces]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Prop:
    """A thing on the table; its origin is the centre of the face it stands on.

    size: depth, width and height, m; mass kg; friction: lateral; fixed: it cannot be moved; shapes: what is drawn;
    hull: what touches, the drawn shapes when empty.
    """

    name: str
    size: Vector
    mass: float
    rgba: tuple[float, float, float, float]
    shapes: tuple[Shape, ...]
    hull: tuple[Shape, ...] = ()
    friction: float = 0.6
    fixed: bool = False

    @property
    def radius(self) -> float:
        """Radius of the circle around its outline, m."""
        return 0.5 * float(np.hypot(*self.size[:2]))

    @property
    def centre(self) -> Vector:
        """Its centre of mass, m: the middle of its bounding box."""
        return 0.0, 0.0, 0.5 * self.size[2]

    @property
    def _touching(self) -> tuple[Shape, ...]:
        return tuple(shape.core for shape in self.hull or self.shapes)

    def files(self) -> dict[str, str]:
        """The prop as files by name: a URDF and the meshes it names."""
        meshes = {s.file: s.mesh() for s in (*self.shapes, *self._touching) if s.kind == "frustum"}
        return {f"{self.name}.urdf": self.urdf(), **meshes}

    def urdf(self) -> str:
        """The prop as a URDF of one link; its inertia is that of its bounding box."""
        x, y, z = (self.mass / 12.0 * (a * a + b * b) for a, b in _others(self.size))
        colour = f'<material name="own"><color rgba="{_numbers(self.rgba)}"/></material>'
        drawn = "".join(f"<visual>{s.urdf()}{colour}</visual>" for s in self.shapes)
        touching = "".join(f"<collision>{s.urdf()}</collision>" for s in self._touching)
        return (
            f'<robot name="{self.name}"><link name="{self.name}"><inertial><origin xyz="0 0 {self.size[2] / 2:.9g}"/>'
            f'<mass value="{self.mass:.9g}"/><inertia ixx="{x:.9g}" ixy="0" ixz="0" iyy="{y:.9g}" iyz="0" izz="{z:.9g}"/>'
            f"</inertial>{drawn}{touching}</link></robot>"
        )


def ring(bottom: float, top: float, height: float, wall: float, sides: int = 16) -> tuple[Shape, ...]:
    """Upright wall (outer radii at bottom and top, m) of a cup, as flat staves."""
    lean = float(np.arctan2(top - bottom, height))
    middle, length = 0.5 * (bottom + top) - 0.5 * wall, height / np.cos(lean)
    width = 2 * max(bottom, top) * np.tan(np.pi / sides)
    staves = []
    for angle in np.arange(sides) * 2 * np.pi / sides:
        turn = Rotation.from_euler("z", angle) * Rotation.from_euler("y", lean)
        place = (middle * np.cos(angle), middle * np.sin(angle), height / 2)
        roll, pitch, yaw = turn.as_euler("xyz").tolist()
        staves.append(Shape("box", (wall, width, length), place, (roll, pitch, yaw)))
    return tuple(staves)


def open_box(depth: float, width: float, height: float, wall: float) -> tuple[Shape, ...]:
    """Floor and four walls of a box without a lid; outer edges, m."""
    x, y, z = (depth - wall) / 2, (width - wall) / 2, (height + wall) / 2
    rise = height - wall
    return (
        Shape("box", (depth, width, wall), (0.0, 0.0, wall / 2)),
        *(Shape("box", (wall, width, rise), (s * x, 0.0, z)) for s in (-1.0, 1.0)),
        *(Shape("box", (depth - 2 * wall, wall, rise), (0.0, s * y, z)) for s in (-1.0, 1.0)),
    )


def _others(size: Vector) -> tuple[tuple[float, float], ...]:
    return (size[1], size[2]), (size[0], size[2]), (size[0], size[1])


def _numbers(values) -> str:
    return " ".join(f"{v:.9g}" for v in values)
