"""Meshes of the robot's visuals, the table and the props, each in the frame of its body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.geometry.mesh import surface_of_revolution
from embodiedreamer_gym.robot.urdf import read_xml

SIDES = 48  # of round shapes
ROUNDING = 0.0025  # m, bevel of the robot's edges; moves its outline by 0.7 mm
PROUD = 0.0012  # m, by which decorations protrude
TABLE_CLASS, ROBOT_CLASS, FIRST_PROP = 1, 2, 3

Faces = list[tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Part:
    """One closed shape of a body.

    body: link or prop that it belongs to.
    number: segmentation class.
    material: name of its surface in `Appearance.surfaces`.
    points: vertices (N, 3) in the body's frame, m.
    faces: vertex numbers, counter-clockwise seen from outside.
    rounding: bevel of its edges, m.
    colour: in the simulator, used if the appearance has no such surface.
    """

    body: str
    number: int
    material: str
    points: np.ndarray
    faces: Faces
    rounding: float = 0.0
    colour: tuple[float, float, float] = (0.6, 0.6, 0.6)

    def __repr__(self) -> str:
        return f"Part({self.body!r}, {self.material!r}, {len(self.points)} points)"


def robot_parts(urdf: Path) -> list[Part]:
    """The robot's visuals by link, with the names of the URDF's materials.

    Raises: ModelError for a visual that is not a box, cylinder or sphere.
    """
    parts = []
    for link in read_xml(urdf).iter("link"):
        for visual in link.iter("visual"):
            element = visual.find("material")
            own = "shell" if element is None else str(element.get("name"))
            name, kind, size, pose = str(link.get("name")), *_visual(visual, f"{urdf.name}, link {link.get('name')}")
            for material, (points, faces) in [(own, SHAPES[kind](*size)), *_decorations(kind, size, own)]:
                points = points @ pose[:3, :3].T + pose[:3, 3]
                rounding = ROUNDING if material == own else 0.0005
                parts.append(Part(name, ROBOT_CLASS, material, points, faces, rounding))
    return parts


def table_part() -> Part:
    """The table's slab."""
    points, faces = _placed(TABLE.shapes[0])
    return Part(TABLE.name, TABLE_CLASS, "table", points, faces, 0.002)


def prop_parts(prop: Prop, number: int) -> list[Part]:
    """A prop's shapes; their material is the prop's name, with a number for each further colour."""
    colours = list(dict.fromkeys(shape.rgba or prop.rgba for shape in prop.shapes))
    parts = []
    for shape in prop.shapes:
        colour = shape.rgba or prop.rgba
        which = colours.index(colour)
        points, faces = _placed(shape)
        rounding = min(0.15 * float(min(np.ptp(points, axis=0))), ROUNDING) if shape.kind == "box" else 0.0
        parts.append(Part(prop.name, number, prop.name + (f"{which + 1}" if which else ""), points, faces, rounding,
                          colour[:3]))  # fmt: skip
    return parts


def scene_parts(urdf: Path, props: Sequence[Prop]) -> list[Part]:
    """The parts of a robot and of props."""
    return [*robot_parts(urdf), *(part for i, prop in enumerate(props) for part in prop_parts(prop, FIRST_PROP + i))]


def box(size: tuple[float, ...]) -> tuple[np.ndarray, Faces]:
    """A box around the origin; size: its three edges, m."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces: Faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners * np.array(size), faces


def cylinder(radius: float, length: float) -> tuple[np.ndarray, Faces]:
    """An upright cylinder around the origin, m."""
    half = 0.5 * length
    return surface_of_revolution([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def sphere(radius: float) -> tuple[np.ndarray, Faces]:
    """A sphere around the origin, m."""
    steps = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)[1:-1]
    arc = [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in steps]
    return surface_of_revolution([(0.0, -radius), *arc, (0.0, radius)])


SHAPES = {"box": lambda *size: box(size), "cylinder": cylinder, "sphere": sphere}
SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def _placed(shape: Shape) -> tuple[np.ndarray, Faces]:
    """A prop's shape in the prop's frame."""
    if shape.kind == "box":
        points, faces = box(shape.size)
    elif shape.kind == "cylinder":
        points, faces = cylinder(*shape.size)
    else:
        points, faces = surface_of_revolution(shape.outline)
    return points @ Rotation.from_euler("xyz", shape.rpy).as_matrix().T + shape.position, faces


def _visual(visual: Element, where: str) -> tuple[str, tuple[float, ...], np.ndarray]:
    """Kind, size and pose (4, 4) in its link's frame of a URDF's visual."""
    origin, geometry = visual.find("origin"), next(iter(visual.iterfind("geometry/*")), None)
    kind = "nothing" if geometry is None else geometry.tag
    if geometry is None or kind not in SHAPES:
        raise ModelError(f"{where}: a visual is {kind}; the path-traced camera draws {', '.join(SHAPES)}.")
    size = tuple(number for key in SIZES[kind] for number in _numbers(str(geometry.get(key))))
    values = {"xyz": "0 0 0", "rpy": "0 0 0"} | ({} if origin is None else dict(origin.items()))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", list(_numbers(values["rpy"]))).as_matrix()
    pose[:3, 3] = list(_numbers(values["xyz"]))
    return kind, size, pose


def _decorations(kind: str, size: tuple[float, ...], material: str) -> Iterator[tuple[str, tuple[np.ndarray, Faces]]]:
    """Details of real arms, less than a pixel deep: collars around long boxes, lids with screws on cylinders."""
    if kind == "box" and max(size) > 0.06 and material == "shell":
        along = int(np.argmax(size))
        for share in (-0.4, 0.4):
            collar = [edge + PROUD for edge in size]
            collar[along] = 0.007
            points, faces = box(tuple(collar))
            points[:, along] += share * size[along]
            yield "housing", (points, faces)
    if kind == "cylinder" and size[0] > 0.02:
        radius, length = size
        yield "accent", cylinder(0.72 * radius, length + PROUD)
        for angle in np.arange(6) * np.pi / 3:
            points, faces = cylinder(0.06 * radius, length + 2 * PROUD)
            yield "pad", (points + 0.56 * radius * np.array([np.cos(angle), np.sin(angle), 0.0]), faces)


def _numbers(text: str) -> Iterator[float]:
    return (float(word) for word in text.split())
