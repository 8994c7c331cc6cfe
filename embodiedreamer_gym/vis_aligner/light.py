"""The light of a bench: points from which it comes, and how much of it the robot and the objects keep from the table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.condition import ROBOT, Condition
from embodiedreamer_gym.vis_aligner.shadows import Plane, hulls_before_camera, lit_pixels

GAMMA = 2.2  # of the camera: light is the power of this of a pixel
SOFT = 0.8 / 128  # of the width: standard deviation by which shadows are blurred, as the lens does
DARKEST = 0.05  # share of the light that is left anywhere: what the room reflects


@dataclass(frozen=True, eq=False)
class Light:
    """Point lights that stand for all the light of a bench before a camera.

    positions (M, 3): m, in the camera's frame (x right, y down, z forward); strengths (M,): not negative; plane: of the
    table; receivers (H, W) bool: pixels that show the table where nothing hides it; matrix (3, 3): the camera's intrinsics.

    Raises: VisionError where shapes differ or numbers are not finite, a strength is negative, or a light is below the table.
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
                "a light's positions, strengths, plane and matrix must be finite numbers of a real camera."
            )
        if self.strengths.min() < 0 or self.strengths.sum() <= 0 or self.plane.heights(self.positions).min() <= 0:
            raise VisionError("a light's strengths must not be negative, and its positions above the table.")

    def __repr__(self) -> str:
        return f"Light({len(self.strengths)} points)"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self.receivers.shape[1], self.receivers.shape[0]

    @cached_property
    def shares(self) -> np.ndarray:
        """Share (M, H, W) float32 of each light in what reaches a pixel of the table when nothing stands on it."""
        return shares(self.positions, self.strengths, self.plane, self.matrix, self.size)

    def shade(self, condition: Condition) -> np.ndarray:
        """Each pixel's value over that in no shadow (T, H, W) float32, on the table; 1 elsewhere.

        Raises: VisionError for another size, or a condition without hulls.
        """
        if condition.size != self.size or condition.hulls is None:
            raise VisionError(
                f"the light is known of pictures of {self.size}, with hulls; the condition is {condition.size}."
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
        """The condition with its shade; as it is where that is known already, or no hulls are."""
        known = condition.shade is not None or condition.hulls is None
        return condition if known else replace(condition, shade=self.shade(condition))


def shares(positions: np.ndarray, strengths: np.ndarray, plane: Plane, matrix: np.ndarray,
           size: tuple[int, int]) -> np.ndarray:  # fmt: skip
    """Share (M, H, W) float32 of each light in what reaches the pixels of a plane: its strength by cosine and distance."""
    light = strengths[:, None, None] * incidence(positions, plane, matrix, size)
    return light / np.maximum(light.sum(axis=0), 1e-9)


def incidence(positions: np.ndarray, plane: Plane, matrix: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Cosine over squared distance (M, H, W) float32, 1/m^2, of lights (M, 3) at the pixels of a plane."""
    points, _ = plane.seen(matrix, size)
    away = np.stack([np.linalg.norm(position - points, axis=-1) for position in positions])
    return (plane.heights(positions)[:, None, None] / np.maximum(away, 0.05) ** 3).astype(np.float32)


def relit(picture: np.ndarray, before: np.ndarray | float, now: np.ndarray | float) -> np.ndarray:
    """Pixels (..., H, W, 3) uint8 of a picture, seen in a shade (..., H, W), as another shade shows them; the same bits
    where the two are the same.
    """
    ratio = np.asarray(now, np.float32) / np.asarray(before, np.float32)
    return np.clip(np.round(picture * ratio[..., None]), 0, 255).astype(np.uint8)


def unshaded(picture: np.ndarray, seen_in: Condition) -> np.ndarray:
    """A picture (H, W, 3) uint8 without the shadows of the last frame of a condition, as far as they are known."""
    return picture if seen_in.shade is None else relit(picture, seen_in.shade[-1], 1.0)


def carried_light(picture: np.ndarray, seen_in: Condition, now: Condition) -> np.ndarray:
    """A picture (H, W, 3) uint8 of the instant of a condition of one frame in the light of each frame of another (T, H, W, 3):
    table and background, as far as the light is known; a thing keeps its colours.
    """
    if seen_in.shade is None or now.shade is None:
        return np.repeat(picture[None], len(now), axis=0)
    thing = seen_in.classes[0] >= ROBOT
    return relit(picture, seen_in.shade[0], np.where(thing, seen_in.shade[0], now.shade))
