"""Convex hulls, approximated by a fixed number of points."""

from __future__ import annotations

import numpy as np

POINTS = 48  # of a hull: they approximate its outline to a few hundredths of its size
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def directions(count: int = POINTS) -> np.ndarray:
    """Unit vectors (count, 3), evenly spread over all directions along a spiral."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    radius, angle = np.sqrt(1.0 - height**2), GOLDEN * np.arange(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def hull_points(vertices: np.ndarray, count: int = POINTS) -> np.ndarray:
    """Points (count, 3) of the convex hull of vertices (V, 3): the farthest in each direction, so some may repeat."""
    vertices = np.asarray(vertices, float)
    return vertices[np.argmax(directions(count) @ vertices.T, axis=1)].astype(np.float32)
