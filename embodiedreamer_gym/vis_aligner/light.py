"""The light of a bench: point lights, and the shadows that robot and objects cast on the table in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.condition import ROBOT, Condition
from embodiedreamer_gym.vis_aligner.shadows import Plane, hulls_before_camera, lit_pixels

GAMMA = 2.2  # of the camera: linear light is the pixel's value to the power of GAMMA
SOFT = 0.8 / 128  # of the width: standard deviation of the blur of shadows, as by the lens
DARKEST = 0.05  # smallest share of the light at any pixel, which the room reflects


@dataclass(frozen=True, eq=False)
class Light:
    """Point lights that approximate all the light on a bench, in the frame of one camera.

    positions (M, 3): m, in the camera's frame (x right, y down, z forward); strengths (M,): not negative; plane: of the
    table; receivers (H, W) bool: pixels that show the table if nothing covers it; matrix (3, 3): the camera's
    intrinsics.

    Raises: VisionError where shapes differ or numbers are not finite, a strength is negative, or a light is not above
    the table.
    """

    positions: np.ndarray
    strengths: np.ndarray
    plane: Plane
    receivers: np.ndarray
    matrix: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.strengths)
        shapes = self.positions.shape, self.strengths.shape, self.plane.normal.shape, self.matrix.shape
        if shapes != ((count, 3), (count,), (3,), (3, 3)) or not count or self.receivers.ndim != 2:
            raise VisionError(
                f"a light needs positions (M, 3), strengths (M,), a normal (3,), a matrix (3, 3), not {shapes}."
            )
        numbers = self.positions, self.strengths, self.plane.normal, np.array(self.plane.offset), self.matrix
        if not all(np.isfinite(x).all() for x in numbers) or abs(np.linalg.det(self.matrix)) < 1e-6:
            raise VisionError(
                "a light's positions, strengths, plane and matrix must be finite, and the matrix invertible."
            )
        if self.strengths.min() < 0 or self.strengths.sum() <= 0 or self.plane.heights(self.positions).min() <= 0:
            raise VisionError("a light's strengths must not be negative, and its positions must be above the table.")

    def __repr__(self) -> str:
        return f"Light({len(self.strengths)} points)"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self.receivers.shape[1], self.receivers.shape[0]

    @cached_property
    def shares(self) -> np.ndarray:
        """Share (M, H, W) float32 of each light in the total light on each pixel of the table, without shadows."""
        return shares(self.positions, self.strengths, self.plane, self.matrix, self.size)

    def shade(self, condition: Condition) -> np.ndarray:
        """Ratio (T, H, W) float32 of each table pixel's value to its value without shadows; 1 outside the table.

        Raises: VisionError for another size, or a condition without hulls.
        """
        if condition.size != self.size or condition.hulls is None:
            raise VisionError(
                f"the light needs a condition of size {self.size} with hulls; the condition has size {condition.size}."
            )
        points = hulls_before_camera(condition, self.matrix)
        shade = np.zeros(condition.classes.shape, np.float32)
        masks = lit_pixels(points, self.positions, self.plane, self.matrix, self.size)
        for lit, share in zip(masks, self.shares, strict=True):
            lit *= share
            shade += lit
        soft = np.stack([cv2.GaussianBlur(one, (0, 0), SOFT * self.size[0]) for one in shade])
        return np.where(self.receivers, np.maximum(soft, DARKEST) ** np.float32(1 / GAMMA), np.float32(1.0))

    def on(self, condition: Condition) -> Condition:
        """The condition with its shade added; unchanged if it already has a shade, or has no hulls."""
        known = condition.shade is not None or condition.hulls is None
        return condition if known else replace(condition, shade=self.shade(condition))


def shares(positions: np.ndarray, strengths: np.ndarray, plane: Plane, matrix: np.ndarray,
           size: tuple[int, int]) -> np.ndarray:  # fmt: skip
    """Share (M, H, W) float32 of each light in the total light on the pixels of a plane: strength times `incidence`."""
    light = strengths[:, None, None] * incidence(positions, plane, matrix, size)
    return light / np.maximum(light.sum(axis=0), 1e-9)


def incidence(positions: np.ndarray, plane: Plane, matrix: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Cosine over squared distance (M, H, W) float32, 1/m^2, of lights (M, 3) at the pixels of a plane."""
    points, _ = plane.seen(matrix, size)
    away = np.stack([np.linalg.norm(position - points, axis=-1) for position in positions])
    return (plane.heights(positions)[:, None, None] / np.maximum(away, 0.05) ** 3).astype(np.float32)


def relit(picture: np.ndarray, before: np.ndarray | float, now: np.ndarray | float) -> np.ndarray:
    """A picture's pixels (..., H, W, 3) uint8, changed from one shade (..., H, W) to another.

    Where both shades are equal, the pixels stay bit-identical.
    """
    ratio = np.asarray(now, np.float32) / np.asarray(before, np.float32)
    return np.clip(np.round(picture * ratio[..., None]), 0, 255).astype(np.uint8)


def unshaded(picture: np.ndarray, seen_in: Condition) -> np.ndarray:
    """A picture (H, W, 3) uint8 without the shadows in a condition's last frame; unchanged if these are not known."""
    return picture if seen_in.shade is None else relit(picture, seen_in.shade[-1], 1.0)


def carried_light(picture: np.ndarray, seen_in: Condition, now: Condition) -> np.ndarray:
    """A picture (H, W, 3) uint8 with the shadows of each frame of another condition (T, H, W, 3).

    seen_in: the condition (T = 1) of the picture. Robot and objects keep their colours. If a shade is not known, the
    picture is only repeated.
    """
    if seen_in.shade is None or now.shade is None:
        return np.repeat(picture[None], len(now), axis=0)
    thing = seen_in.classes[0] >= ROBOT
    return relit(picture, seen_in.shade[0], np.where(thing, seen_in.shade[0], now.shade))
