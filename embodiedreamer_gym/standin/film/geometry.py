"""What stands before the camera as meshes: the robot's visuals, the table and the props, each in its body's frame."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.errors import ModelError

SIDES = 48  # of whatever is round
ROUNDING = 0.0025  # m of the edges of the robot's parts, 0.7 mm off its outline
PROUD = 0.0012  # m by which trimmings stand out
TABLE_CLASS, ROBOT_CLASS, FIRST_PROP = 1, 2, 3

Faces = list[tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Part:
    """One closed shape of a body.

    body: the link or prop that carries it; number: its segmentation class; paint: name of what it is made of; points
    (N, 3), m, in the body's frame; faces: corners, seen from outside; rounding: m of its edges; colour: the simulator's,
    for what a look has no surface for.
    """

    body: str
    number: int
    paint: str
    points: np.ndarray
    faces: Faces
    rounding: float = 0.0
    colour: tuple[float, float, float] = (0.6, 0.6, 0.6)

    def __repr__(self) -> str:
        return f"Part({self.body!r}, {self.paint!r}, {len(self.points)} points)"


def robot_parts(urdf: Path) -> list[Part]:
    """The robot's visuals by link; what they are made of is the name of the URDF's material.

    Raises: ModelError for a visual that is no box, cylinder or sphere.
    """
    parts = []
    for link in ElementTree.parse(urdf).getroot().iter("link"):
        for visual in link.iter("visual"):
            material = visual.find("material")
            paint = "shell" if material is None else str(material.get("name"))
            name, kind, size, place = str(link.get("name")), *_visual(visual, f"{urdf.name}, link {link.get('name')}")
            for made, shape in [(paint, SHAPES[kind](*size)), *_trimmings(kind, size, paint)]:
                points = shape[0] @ place[:3, :3].T + place[:3, 3]
                parts.append(Part(name, ROBOT_CLASS, made, points, shape[1], ROUNDING if made == paint else 0.0005))
    return parts


def table_part() -> Part:
    """The table's slab."""
    points, faces = _placed(TABLE.shapes[0])
    return Part(TABLE.name, TABLE_CLASS, "table", points, faces, 0.002)


def prop_parts(prop: Prop, number: int) -> list[Part]:
    """A prop's shapes; what they are made of is its name, with a number for each further colour."""
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
    """The parts of a robot, then those of what stands before it."""
    return [*robot_parts(urdf), *(part for i, prop in enumerate(props) for part in prop_parts(prop, FIRST_PROP + i))]


def box(size: tuple[float, ...]) -> tuple[np.ndarray, Faces]:
    """A box around the origin: its three edges, m."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces: Faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners * np.array(size), faces


def turned(outline: list[tuple[float, float]], sides: int = SIDES) -> tuple[np.ndarray, Faces]:
    """A closed outline of (radius, height), m, turned about z; its first and last points lie on the axis."""
    angles = np.arange(sides) * 2 * np.pi / sides
    round_ = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, rings = [], []
    for radius, height in outline:
        ring = round_[: 1 if radius == 0.0 else sides] * radius
        rings.append(np.arange(len(ring)) + sum(map(len, points)))
        points.append(np.column_stack([ring, np.full(len(ring), height)]))
    faces: Faces = []
    for low, high in itertools.pairwise(rings):
        for i in range(sides):
            j = (i + 1) % sides
            corners = [*(low[[i, j]] if len(low) > 1 else low), *(high[[j, i]] if len(high) > 1 else high)]
            if len(corners) > 2:
                faces.append(tuple(int(corner) for corner in corners))
    return np.concatenate(points), faces


def cylinder(radius: float, length: float) -> tuple[np.ndarray, Faces]:
    """An upright cylinder around the origin, m."""
    half = 0.5 * length
    return turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def sphere(radius: float) -> tuple[np.ndarray, Faces]:
    """A ball around the origin, m."""
    steps = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)[1:-1]
    arc = [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in steps]
    return turned([(0.0, -radius), *arc, (0.0, radius)])


SHAPES = {"box": lambda *size: box(size), "cylinder": cylinder, "sphere": sphere}
SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def _placed(shape: Shape) -> tuple[np.ndarray, Faces]:
    """A prop's shape in the prop's frame."""
    if shape.kind == "box":
        points, faces = box(shape.size)
    elif shape.kind == "cylinder":
        points, faces = cylinder(*shape.size)
    else:
        points, faces = turned(list(zip(shape.size[::2], shape.size[1::2], strict=True)))
    return points @ Rotation.from_euler("xyz", shape.rpy).as_matrix().T + shape.position, faces


def _visual(visual: ElementTree.Element, where: str) -> tuple[str, tuple[float, ...], np.ndarray]:
    """A URDF's visual: its kind, its size, and where (4, 4) it is in its link's frame."""
    origin, geometry = visual.find("origin"), next(iter(visual.iterfind("geometry/*")), None)
    kind = "nothing" if geometry is None else geometry.tag
    if geometry is None or kind not in SHAPES:
        raise ModelError(f"{where}: a visual is {kind}; the path-traced camera draws {', '.join(SHAPES)}.")
    size = tuple(number for key in SIZES[kind] for number in _numbers(str(geometry.get(key))))
    place = {"xyz": "0 0 0", "rpy": "0 0 0"} | ({} if origin is None else dict(origin.items()))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", list(_numbers(place["rpy"]))).as_matrix()
    pose[:3, 3] = list(_numbers(place["xyz"]))
    return kind, size, pose


def _trimmings(kind: str, size: tuple[float, ...], paint: str) -> Iterator[tuple[str, tuple[np.ndarray, Faces]]]:
    """Collars around long boxes; lids with screws on cylinders: nothing a pixel wide, but real arms have them."""
    if kind == "box" and max(size) > 0.06 and paint == "shell":
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
