"""A look, the bodies and their poses as one scene for Blender, all of it JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.standin.film.appearance import Block, Lamp, Look
from embodiedreamer_gym.standin.film.blender import camera_spec
from embodiedreamer_gym.standin.film.geometry import Part, box, table_part
from embodiedreamer_gym.standin.film.materials import Surface, nodes_of

DECK = Block((-0.06, 0.0, 0.655), (0.72, 0.84, 0.2), 0.0, "deck")  # ends below and before what the simulator draws
MAST = Block((-0.28, 0.0, 1.0), (0.05, 0.05, 2.0), 0.0, "legs")
ROOM = 7.0  # m, of floor and wall to the sides
LEG = 0.05  # m


@dataclass(frozen=True, eq=False)
class Take:
    """What is to be filmed: the moving bodies' parts, their names, and their poses (T, bodies, 4, 4) in the world."""

    parts: Sequence[Part]
    bodies: tuple[str, ...]
    poses: np.ndarray


def make_scene(take: Take, look: Look, camera: Camera, samples: int = 4, classes: bool = False) -> dict[str, Any]:
    """A scene for `render`: every frame of a take, before a standing pinhole camera of the pictures' own size.

    samples: light paths per pixel; classes: show the class numbers instead (in red).
    """
    rng = np.random.default_rng(look.seed)
    parts = [*take.parts, *_standing(table_part(), TABLE_CENTRE), *room_parts(look)]
    surfaces = {part.paint: Surface("plain", (part.colour,)) for part in parts} | dict(look.surfaces)
    shifts = {name: np.round(rng.uniform(-5.0, 5.0, 3), 3).tolist() for name in sorted(look.surfaces)}
    names = dict.fromkeys(part.paint for part in parts)
    return {
        "size": list(camera.size), "samples": samples, "seed": look.seed, "classes": classes,
        "camera": camera_spec(camera),
        "sky": {"colour": list(look.sky[0]), "strength": 0.0 if classes else look.sky[1]},
        "lamps": [_lamp(lamp) for lamp in look.lamps],
        "paints": {name: nodes_of(surfaces[name], shifts.get(name, [0.0] * 3)) for name in names},
        "parts": [{"body": part.body if part.body in take.bodies else None, "number": part.number, "paint": part.paint,
                   "points": np.round(part.points, 7).tolist(), "faces": [list(face) for face in part.faces], "rounding": part.rounding}
                  for part in parts],
        "moving": list(take.bodies),
        "frames": np.round(take.poses, 9).tolist(),
    }  # fmt: skip


def room_parts(look: Look) -> list[Part]:
    """What stands around the table: nothing of it hides what the simulator draws."""
    x, y, z = TABLE_CENTRE[0], TABLE.size[1] / 2 - 0.08, TABLE.size[2] - 0.04
    legs = [Block((x + s * (TABLE.size[0] / 2 - 0.06), t * y, z / 2), (LEG, LEG, z), 0.0, "legs")
            for s in (-1, 1) for t in (-1, 1)]  # fmt: skip
    wall = [
        Block((look.wall + 0.05, 0.0, 1.5), (0.1, 2 * ROOM, 3.0), look.turn, "wall"),
        Block((look.wall - 0.006, 0.0, 0.05), (0.012, 2 * ROOM, 0.1), look.turn, "skirting"),
    ]
    floor = Block((0.0, 0.0, -0.05), (2 * ROOM, 2 * ROOM, 0.1), 0.0, "floor")
    kept = [block for block in look.blocks if block.position[0] + 0.3 < look.wall - 0.25 * abs(block.position[1])]
    return [_block(block) for block in (floor, *wall, DECK, MAST, *legs, *kept)]


def _block(block: Block) -> Part:
    points, faces = box(block.size)
    turned = points @ Rotation.from_euler("z", block.turn).as_matrix().T + block.position
    return Part("room", 0, block.surface, turned, faces, 0.006 if min(block.size) > 0.04 else 0.0)


def _standing(part: Part, place: Sequence[float]) -> list[Part]:
    return [Part("room", part.number, part.paint, part.points + place, part.faces, part.rounding)]


def _lamp(lamp: Lamp) -> dict[str, Any]:
    """A lamp as Blender's, which shines along minus z."""
    pose = np.eye(4)
    facing = Rotation.from_quat(look_at(lamp.position, lamp.target, up=(1.0, 0.0, 0.001))).as_matrix()
    pose[:3, :3], pose[:3, 3] = facing * (1.0, -1.0, -1.0), lamp.position
    return {"pose": pose.tolist(), "size": list(lamp.size), "power": lamp.power, "colour": list(lamp.colour)}
