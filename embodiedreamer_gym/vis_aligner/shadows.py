"""Shadows of convex parts on a plane under point lights, as polygons in a picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.condition import Condition

LOWEST = 0.05  # points higher than (1 - LOWEST) times a light's height are lowered to that height
NEAREST = 0.05  # m in front of the camera; shadows that come nearer are left out
STILL = 1e-4  # m: a part that moves less counts as still
FINE = 4  # fractional bits of polygon corners
FAR = 20000  # pixels: limit of polygon corners


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in a camera's frame (x right, y down, z forward).

    normal (3,): unit vector that points to the plane's upper side; offset: m, of the plane's points along the normal.
    """

    normal: np.ndarray
    offset: float

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Heights (...) of points (..., 3) above the plane, m."""
        return points @ self.normal - self.offset

    def seen(self, matrix: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Points (H, W, 3), m, of the plane at the pixels of a picture, and where (H, W) pixels show the plane.

        matrix: intrinsics (3, 3); size: width and height.
        """
        rays = pixel_rays(matrix, size)
        slope = rays @ self.normal
        hit = np.where(np.abs(slope) > 1e-6, self.offset / np.where(np.abs(slope) > 1e-6, slope, 1.0), -1.0)
        return rays * np.maximum(hit, 0.0)[..., None], hit > NEAREST


def pixel_rays(matrix: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Rays (H, W, 3) of the pixels of a picture, with depth 1."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(matrix).T


def intrinsics(projections: np.ndarray) -> np.ndarray:
    """The camera's intrinsics K (3, 3), from projections (..., 3, 4) of rigid parts.

    The first three columns of a projection are K R with a rotation R; multiplied by their transpose, they give K K^T.
    """
    turned = np.asarray(projections, float).reshape(-1, 3, 4)[0, :, :3]
    flipped = np.linalg.cholesky((turned @ turned.T)[::-1, ::-1])[::-1, ::-1]
    return flipped / flipped[2, 2]


def hulls_before_camera(condition: Condition, matrix: np.ndarray) -> np.ndarray:
    """Hull points (T, L', 3, P) float32, m in the camera's frame, of the parts that have a shape.

    matrix: intrinsics (3, 3).
    """
    hulls, projections = np.asarray(condition.hulls, np.float32), np.asarray(condition.projections, float)
    shaped = np.ptp(hulls, axis=1).max(axis=1) > 0
    poses = (np.linalg.inv(matrix) @ projections[:, shaped]).astype(np.float32)
    return poses[..., :3] @ hulls[shaped].swapaxes(1, 2) + poses[..., 3:]


def lit_pixels(points: np.ndarray, lights: np.ndarray, plane: Plane, matrix: np.ndarray,
               size: tuple[int, int]) -> Iterator[np.ndarray]:  # fmt: skip
    """For each light, a mask (T, H, W) float32 of a plane's pixels: 1.0 where the light reaches the plane, else 0.0.

    points (T, L, 3, P): of convex parts, m; lights (M, 3): m, above the plane; all in the camera's frame; matrix:
    intrinsics (3, 3); size: width and height of the picture.
    """
    standing = np.ptp(points, axis=0).max(axis=(1, 2)) < STILL
    moving, fixed = (_Casting.of(some, plane, matrix) for some in (points[:, ~standing], points[:1, standing]))
    for source, top in zip(lights @ matrix.T, plane.heights(lights), strict=True):
        lit = np.ones((len(points), size[1], size[0]), np.float32)
        for _, corners in fixed.shadows(source, top, size):
            cv2.fillConvexPoly(lit[0], cv2.convexHull(corners), 0.0, shift=FINE)
        lit[1:] = lit[0]
        for time, corners in moving.shadows(source, top, size):
            cv2.fillConvexPoly(lit[time], cv2.convexHull(corners), 0.0, shift=FINE)
        yield lit


@dataclass(frozen=True, eq=False)
class _Casting:
    """Points of convex parts above a plane: scaled (T, L, 3, P), which is (u, v, 1) depth, and heights (T, L, P), m."""

    scaled: np.ndarray
    heights: np.ndarray

    @staticmethod
    def of(points: np.ndarray, plane: Plane, matrix: np.ndarray) -> _Casting:
        """From points (T, L, 3, P), m; points below the plane are moved up to it."""
        normal = plane.normal.astype(np.float32)
        heights = normal @ points - np.float32(plane.offset)
        raised = points + np.maximum(-heights, 0.0)[:, :, None] * normal[:, None]
        return _Casting(matrix.astype(np.float32) @ raised, np.maximum(heights, 0.0))

    def shadows(self, source: np.ndarray, top: float, size: tuple[int, int]) -> Iterator[tuple[int, np.ndarray]]:
        """Frame number and corners (P, 2) int32, in pixels times 2^FINE, of every shadow that may be in a picture.

        source (3,): the light's (u, v, 1) depth; top: its height, m.
        """
        heights = np.minimum(self.heights, np.float32((1 - LOWEST) * top))[:, :, None]
        falls = np.float32(top) * self.scaled - heights * source.astype(np.float32)[:, None]
        depths = falls[:, :, 2]
        far = (depths.min(axis=2) > NEAREST * LOWEST * top) & (self.heights.max(axis=2) > 0)
        pixels = falls[:, :, :2] / np.where(far[..., None], depths, 1.0)[:, :, None]
        inside = far & (pixels.max(axis=3) > -1).all(axis=2) & (pixels.min(axis=3) < size).all(axis=2)
        corners = np.rint(np.clip(pixels[inside], -FAR, FAR) * (1 << FINE)).astype(np.int32).swapaxes(1, 2)
        yield from zip(np.nonzero(inside)[0].tolist(), np.ascontiguousarray(corners), strict=True)
