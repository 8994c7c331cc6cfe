"""A look of a robot's bench: what everything is made of, the light, the room and the lens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from embodiedreamer_gym.standin.film.camera_noise import Lens
from embodiedreamer_gym.standin.film.materials import Colour, Surface

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Lamp:
    """A rectangle of light: where it is and what it looks at, m; its edges, m; W; colour of the light, 0..1."""

    position: Vector
    target: Vector
    size: tuple[float, float]
    power: float
    colour: Colour


@dataclass(frozen=True)
class Block:
    """Something in the room: a box, its middle and edges in m, turned about z, rad; surface: a name in the look's."""

    position: Vector
    size: Vector
    turn: float
    surface: str


@dataclass(frozen=True)
class Look:
    """Everything that a picture shows beside geometry and motion.

    name: "lab" or "look N"; seed: of pattern places; surfaces: by what they cover; lamps; sky: colour and strength of
    light from everywhere; wall: m ahead of the robot; turn: rad of the wall about z; blocks: what stands in the room.
    """

    name: str
    seed: int
    surfaces: Mapping[str, Surface]
    lamps: tuple[Lamp, ...]
    sky: tuple[Colour, float]
    wall: float
    turn: float
    blocks: tuple[Block, ...]
    lens: Lens

    def as_dict(self) -> dict[str, Any]:
        """The look, fit for JSON."""
        return asdict(self)
