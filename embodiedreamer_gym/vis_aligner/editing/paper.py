"""Edit: a sheet of paper on the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.editing.editor import Masks, things

A4 = (0.297, 0.210)  # m
FINE = 8  # subpixels per pixel, along each side, for the sheet's edge
SOFT = 0.015  # of the width: standard deviation of the smoothing of the light on the sheet
LIGHT = (0.5, 1.1)  # limits of a pixel's light, relative to the median
TONES = (226.0, 248.0)  # grey levels of paper


@dataclass(frozen=True)
class PaperSheet:
    """Adds an A4 sheet in a random position on the table, under robot and objects, and in the table's light.

    camera: the one that took the picture; height: of the table's top, m; area: ranges of x and y of the sheet's centre,
    m; pose: fixed x, y, m, and rotation, rad, instead of random ones; size: m.
    Raises: VisionError for a camera that moves.
    """

    camera: Camera
    height: float = 0.74
    area: tuple[tuple[float, float], tuple[float, float]] = ((0.51, 0.69), (-0.45, 0.45))
    pose: tuple[float, float, float] | None = None
    size: tuple[float, float] = A4

    def __post_init__(self) -> None:
        if self.camera.link is not None:
            raise VisionError(
                f"camera {self.camera.name} is mounted on {self.camera.link}; a sheet needs a fixed camera."
            )

    def __repr__(self) -> str:
        return f"PaperSheet(camera={self.camera.name!r}, height={self.height}, area={self.area}, pose={self.pose})"

    def __call__(
        self, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None = None
    ) -> np.ndarray:
        """The picture (H, W, 3) uint8 with the sheet."""
        drawn = self.draws(masks, rng)
        covered = _covered(self.corners(drawn["x"], drawn["y"], drawn["turn"], image), image) * ~things(masks)
        sheet = drawn["tone"] * _light(image, masks)[..., None] * np.array([1.0, 0.995, 0.98], np.float32)
        out = image + covered[..., None] * (np.minimum(sheet, 255) - image)
        return np.clip(np.round(out), 0, 255).astype(np.uint8)

    def draws(self, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
        """Centre x and y, m, rotation ("turn"), rad, and grey level ("tone") of the sheet."""
        spans = (*self.area, (-np.pi / 2, np.pi / 2), TONES)
        x, y, turn, tone = (round(float(rng.uniform(*span)), 4) for span in spans)
        x, y, turn = self.pose or (x, y, turn)
        return {"x": x, "y": y, "turn": turn, "tone": tone}

    def corners(self, x: float, y: float, turn: float, image: np.ndarray) -> np.ndarray:
        """Pixels (4, 2), u and v, of the corners of a sheet in a picture (H, W, 3).

        Raises: VisionError where a corner is not in front of the camera.
        """
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self.size
        c, s = np.cos(turn), np.sin(turn)
        flat = half @ np.array([[c, s], [-s, c]]) + (x, y)
        position, axes = self.camera.pose()
        points = (np.column_stack([flat, np.full(4, self.height)]) - position) @ axes
        if (points[:, 2] < self.camera.near).any():
            raise VisionError(f"camera {self.camera.name} does not see a sheet at ({x:.2f}, {y:.2f}) m in front of it.")
        pixels = points @ self.camera.matrix((image.shape[1], image.shape[0])).T
        return pixels[:, :2] / pixels[:, 2:]


def _covered(corners: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Share (H, W) of each pixel inside a quadrangle."""
    height, width = image.shape[:2]
    fine = np.zeros((height * FINE, width * FINE), np.uint8)
    cv2.fillConvexPoly(fine, np.round((corners + 0.5) * FINE - 0.5).astype(np.int32), 1)
    return cv2.resize(fine.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)


def _light(image: np.ndarray, masks: Masks) -> np.ndarray:
    """Smoothed light (H, W) on the table, relative to its median; 1 far from the table."""
    table = masks["table"]
    if not table.any():
        return np.ones(table.shape, np.float32)
    grey, weight = image.astype(np.float32).mean(axis=2), table.astype(np.float32)
    soft = max(SOFT * image.shape[1], 0.5)
    near = cv2.GaussianBlur(weight, (0, 0), soft)
    smooth = cv2.GaussianBlur(grey * weight, (0, 0), soft) / np.maximum(near, 1e-3)
    ratio = smooth / max(float(np.median(grey[table])), 1.0)
    return np.where(near > 0.02, np.clip(ratio, *LIGHT), 1.0).astype(np.float32)
