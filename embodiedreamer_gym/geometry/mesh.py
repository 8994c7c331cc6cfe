"""Meshes of simple solids."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

SIDES = 48
Faces = list[tuple[int, ...]]


def surface_of_revolution(outline: Sequence[tuple[float, float]], sides: int = SIDES) -> tuple[np.ndarray, Faces]:
    """Points (N, 3), m, and faces of an outline rotated about z.

    outline: (radius, height), m, from axis to axis.
    sides: number of flat pieces around the axis.
    """
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
