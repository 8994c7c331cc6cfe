"""Frames on the table for key poses: each object has one along its axis and one pointing away from the arm's base."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
Scene = Mapping[
    str, tuple[float, float, float]
]  # object -> x, y (m) and the angle (rad) of its axis, in the robot's frame
OUTWARD = " outward"  # after the name of an object


def folded(angle: float) -> float:
    """The angle of an undirected axis, wrapped to -pi/2 .. pi/2."""
    return float((angle + np.pi / 2) % np.pi - np.pi / 2)


def frames(scene: Scene, base: Array, flipped: str | None = None) -> dict[str, tuple[float, float, float]]:
    """Position (m) and direction (rad) of each frame; each object has two.

    The axis of an object points away from the base (3,), because its two ends are hard to tell apart; the axis of
    `flipped` points towards the base.
    """
    found = {}
    for name, (x, y, angle) in scene.items():
        out = float(np.arctan2(y - base[1], x - base[0]))
        found[name] = (x, y, out + folded(angle - out) + (np.pi if name == flipped else 0.0))
        found[name + OUTWARD] = (x, y, out)
    return found


def thing(frame: str) -> str:
    """The object that a frame belongs to."""
    return frame.removesuffix(OUTWARD)


def into(frame: tuple[float, float, float], position: Array, rotation: Array) -> tuple[Array, Array]:
    """Convert a pose, position (3,) and rotation (3, 3), from the world to a frame."""
    turn = Rotation.from_euler("z", frame[2]).as_matrix()
    return turn.T @ (position - [frame[0], frame[1], 0.0]), turn.T @ rotation


def outof(frame: tuple[float, float, float], position: Array, rotation: Array) -> tuple[Array, Array]:
    """Convert a pose from a frame to the world."""
    turn = Rotation.from_euler("z", frame[2]).as_matrix()
    return turn @ position + [frame[0], frame[1], 0.0], turn @ rotation


def mirrored(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """A scene mirrored in the plane y = 0."""
    return {name: (x, -y, -angle) for name, (x, y, angle) in scene.items()}


def middle(positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Median (3,) of positions (D, 3), and the rotation (3, 3) with the least sum of angles to rotations (D, 3, 3).

    Source: Weiszfeld's algorithm; Hartley, Aftab, Trumpf, CVPR 2011.
    """
    all_of = Rotation.from_matrix(rotations)
    mean, weights = all_of.mean(), np.ones(len(rotations))
    for _ in range(8):
        weights = 1.0 / np.maximum((all_of * mean.inv()).magnitude(), 0.02)
        mean = all_of.mean(weights=weights)
    return np.median(positions, axis=0), mean.as_matrix()


def spread(positions: Array, rotations: Array) -> float:
    """Spread of positions (D, 3) and rotations (D, 3, 3) about their middle: median distance, m, plus 0.1 m per rad."""
    place, turn = middle(positions, rotations)
    angles = (Rotation.from_matrix(rotations) * Rotation.from_matrix(turn).inv()).magnitude()
    return float(np.median(np.linalg.norm(positions - place, axis=1)) + 0.1 * np.median(angles))
