"""Appearance, bodies and poses as one scene for Blender, as JSON-compatible data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.standin.film.appearance import Appearance, Block, Lamp
from embodiedreamer_gym.standin.film.blender import camera_spec
from embodiedreamer_gym.standin.film.geometry import Part, box, table_part
from embodiedreamer_gym.standin.film.materials import Surface, nodes_of

DECK = Block((-0.06, 0.0, 0.655), (0.72, 0.84, 0.2), 0.0, "deck")  # does not hide anything that the simulator draws
MAST = Block((-0.28, 0.0, 1.0), (0.05, 0.05, 2.0), 0.0, "legs")
ROOM = 7.0  # m, half the width of floor and wall
LEG = 0.05  # m, width of a table leg


@dataclass(frozen=True, eq=False)
class Animation:
    """Moving bodies: their parts, their names, and their poses (T, bodies, 4, 4) in the world, m."""

    parts: Sequence[Part]
    bodies: tuple[str, ...]
    poses: np.ndarray


def make_scene(animation: Animation, appearance: Appearance, camera: Camera, samples: int = 4,
               classes: bool = False) -> dict[str, Any]:  # fmt: skip
    """A scene for `render` in blender.py with one frame per pose.

    camera: pinhole, fixed in the world or to one of the bodies, of the renderings' size.
    samples: light paths per pixel.
    classes: render class numbers, in the red channel, instead of light.
    """
    rng = np.random.default_rng(appearance.seed)
    parts = [*animation.parts, _table(), *room_parts(appearance)]
    surfaces = {part.material: Surface("plain", (part.colour,)) for part in parts} | dict(appearance.surfaces)
    shifts = {name: np.round(rng.uniform(-5.0, 5.0, 3), 3).tolist() for name in sorted(appearance.surfaces)}
    names = dict.fromkeys(part.material for part in parts)
    return {
        "size": list(camera.size), "samples": samples, "seed": appearance.seed, "classes": classes,
        "camera": camera_spec(camera),
        "sky": {"colour": list(appearance.sky[0]), "strength": 0.0 if classes else appearance.sky[1]},
        "lamps": [_lamp(lamp) for lamp in appearance.lamps],
        "materials": {name: nodes_of(surfaces[name], shifts.get(name, [0.0] * 3)) for name in names},
        "parts": [{"body": part.body if part.body in animation.bodies else None, "number": part.number, "material": part.material,
                   "points": np.round(part.points, 7).tolist(), "faces": [list(face) for face in part.faces], "rounding": part.rounding}
                  for part in parts],
        "moving": list(animation.bodies),
        "frames": np.round(animation.poses, 9).tolist(),
    }  # fmt: skip


def room_parts(appearance: Appearance) -> list[Part]:
    """Floor, wall, mount, table legs and further boxes; none of them hides what the simulator draws."""
    x, y, z = TABLE_CENTRE[0], TABLE.size[1] / 2 - 0.08, TABLE.size[2] - 0.04
    legs = [Block((x + s * (TABLE.size[0] / 2 - 0.06), t * y, z / 2), (LEG, LEG, z), 0.0, "legs")
            for s in (-1, 1) for t in (-1, 1)]  # fmt: skip
    wall = [
        Block((appearance.wall + 0.05, 0.0, 1.5), (0.1, 2 * ROOM, 3.0), appearance.turn, "wall"),
        Block((appearance.wall - 0.006, 0.0, 0.05), (0.012, 2 * ROOM, 0.1), appearance.turn, "skirting"),
    ]
    floor = Block((0.0, 0.0, -0.05), (2 * ROOM, 2 * ROOM, 0.1), 0.0, "floor")
    kept = [
        block
        for block in appearance.blocks
        if block.position[0] + 0.3 < appearance.wall - 0.25 * abs(block.position[1])
    ]
    return [_block(block) for block in (floor, *wall, DECK, MAST, *legs, *kept)]


def _block(block: Block) -> Part:
    points, faces = box(block.size)
    turned = points @ Rotation.from_euler("z", block.turn).as_matrix().T + block.position
    return Part("room", 0, block.surface, turned, faces, 0.006 if min(block.size) > 0.04 else 0.0)


def _table() -> Part:
    part = table_part()
    return replace(part, body="room", points=part.points + TABLE_CENTRE)


def _lamp(lamp: Lamp) -> dict[str, Any]:
    """A lamp in Blender's convention: it shines along its negative z axis."""
    pose = np.eye(4)
    facing = Rotation.from_quat(look_at(lamp.position, lamp.target, up=(1.0, 0.0, 0.001))).as_matrix()
    pose[:3, :3], pose[:3, 3] = facing * (1.0, -1.0, -1.0), lamp.position
    return {"pose": pose.tolist(), "size": list(lamp.size), "power": lamp.power, "colour": list(lamp.colour)}
