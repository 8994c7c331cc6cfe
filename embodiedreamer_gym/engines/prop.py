"""Props: objects on the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.engines.shapes import Colour, Shape, Vector, numbers


@dataclass(frozen=True)
class Prop:
    """An object on the table; its origin is the centre of its bottom face.

    size: depth, width and height, m; mass: kg; rgba: its colour; shapes: visual shapes; hull: collision shapes, the
    visual shapes if empty; friction: lateral; fixed: whether it cannot move.
    """

    name: str
    size: Vector
    mass: float
    rgba: Colour
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

    def files(self) -> dict[str, str]:
        """The prop as files by name: a URDF and the meshes that it refers to."""
        meshes = {shape.file: shape.mesh() for shape in (*self.shapes, *self._touching) if shape.kind == "turned"}
        return {f"{self.name}.urdf": self.urdf(), **meshes}

    def urdf(self) -> str:
        """The prop as a URDF of one link; its inertia is that of its bounding box."""
        x, y, z = self.size
        xx, yy, zz = (self.mass / 12.0 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y)))
        drawn = "".join(f"<visual>{s.urdf()}{self._material(i, s)}</visual>" for i, s in enumerate(self.shapes))
        touching = "".join(f"<collision>{shape.urdf()}</collision>" for shape in self._touching)
        return (
            f'<robot name="{self.name}"><link name="{self.name}"><inertial><origin xyz="{numbers(self.centre)}"/>'
            f'<mass value="{self.mass:.9g}"/>'
            f'<inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/>'
            f"</inertial>{drawn}{touching}</link></robot>"
        )

    @property
    def _touching(self) -> tuple[Shape, ...]:
        return tuple(shape.core for shape in self.hull or self.shapes)

    def _material(self, number: int, shape: Shape) -> str:
        """Material of one of the shapes; each has its own name, because materials with one name share a colour."""
        return f'<material name="{number}"><color rgba="{numbers(shape.rgba or self.rgba)}"/></material>'
