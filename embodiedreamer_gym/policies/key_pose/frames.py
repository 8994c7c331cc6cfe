"""Frames on the table that key poses are expressed in: of each thing, along its axis or away from the arm's base."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
Scene = Mapping[
    str, tuple[float, float, float]
]  # thing -> x, y (m) and the angle (rad) of its axis, in the robot's frame
OUTWARD = " outward"  # after the name of a thing


def folded(angle: float) -> float:
    """An angle of an axis without direction, -pi/2 .. pi/2."""
    return float((angle + np.pi / 2) % np.pi - np.pi / 2)


def frames(scene: Scene, base: Array, flipped: str | None = None) -> dict[str, tuple[float, float, float]]:
    """Place (m) and direction (rad) of each frame: two for each thing.

    The axis of a thing points away from the base (3,), since which end is which is hard to see; that of `flipped` to the base.
    """
    found = {}
    for name, (x, y, angle) in scene.items():
        out = float(np.arctan2(y - base[1], x - base[0]))
        found[name] = (x, y, out + folded(angle - out) + (np.pi if name == flipped else 0.0))
        found[name + OUTWARD] = (x, y, out)
    return found


def thing(frame: str) -> str:
    """The thing that a frame is of."""
    return frame.removesuffix(OUTWARD)


def into(frame: tuple[float, float, float], position: Array, rotation: Array) -> tuple[Array, Array]:
    """A pose of the world, position (3,) and rotation (3, 3), in a frame."""
    turn = Rotation.from_euler("z", frame[2]).as_matrix()
    return turn.T @ (position - [frame[0], frame[1], 0.0]), turn.T @ rotation


def outof(frame: tuple[float, float, float], position: Array, rotation: Array) -> tuple[Array, Array]:
    """A pose of a frame in the world."""
    turn = Rotation.from_euler("z", frame[2]).as_matrix()
    return turn @ position + [frame[0], frame[1], 0.0], turn @ rotation


def mirrored(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """A scene in the plane y = 0."""
    return {name: (x, -y, -angle) for name, (x, y, angle) in scene.items()}


def middle(positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Median (3,) of positions (D, 3), and the rotation (3, 3) of the least sum of angles to rotations (D, 3, 3).

    Source: Weiszfeld's algorithm; Hartley, Aftab, Trumpf, CVPR 2011.
    """
    all_of = Rotation.from_matrix(rotations)
    mean, weights = all_of.mean(), np.ones(len(rotations))
    for _ in range(8):
        weights = 1.0 / np.maximum((all_of * mean.inv()).magnitude(), 0.02)
        mean = all_of.mean(weights=weights)
    return np.median(positions, axis=0), mean.as_matrix()


def spread(positions: Array, rotations: Array) -> float:
    """How far (D, 3) and (D, 3, 3) differ from their middle: median distance, m, and a tenth of a metre for each rad."""
    place, turn = middle(positions, rotations)
    angles = (Rotation.from_matrix(rotations) * Rotation.from_matrix(turn).inv()).magnitude()
    return float(np.median(np.linalg.norm(positions - place, axis=1)) + 0.1 * np.median(angles))
