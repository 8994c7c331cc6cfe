"""Appearance of a workspace: materials, lights, room, and the errors of the camera that films it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from embodiedreamer_gym.standin.film.camera_noise import CameraNoise
from embodiedreamer_gym.standin.film.materials import Colour, Surface

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Lamp:
    """A rectangular area light.

    position: m; target: point it faces, m; size: of its edges, m; power: W; colour: of its light, 0..1.
    """

    position: Vector
    target: Vector
    size: tuple[float, float]
    power: float
    colour: Colour


@dataclass(frozen=True)
class Block:
    """A box in the room.

    position: of its centre, m; size: of its edges, m; turn: rotation about z, rad; surface: name in
    `Appearance.surfaces`.
    """

    position: Vector
    size: Vector
    turn: float
    surface: str


@dataclass(frozen=True)
class Appearance:
    """Everything that a picture depends on besides geometry and motion.

    name: "lab", or "look N" for a random one (this name is stored in files).
    seed: of the positions of surface patterns.
    surfaces: material by the name of what it covers.
    lamps: area lights.
    sky: colour and strength of the ambient light.
    wall: distance of the back wall from the robot, m.
    turn: rotation of the wall about z, rad.
    blocks: further boxes in the room.
    camera_noise: distortion, exposure and colour response of the camera.
    """

    name: str
    seed: int
    surfaces: Mapping[str, Surface]
    lamps: tuple[Lamp, ...]
    sky: tuple[Colour, float]
    wall: float
    turn: float
    blocks: tuple[Block, ...]
    camera_noise: CameraNoise

    def as_dict(self) -> dict[str, Any]:
        """The appearance as JSON-compatible data, as stored in film files (camera_noise has the key "lens")."""
        data = asdict(self)
        return data | {"lens": data.pop("camera_noise")}
