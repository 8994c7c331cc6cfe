"""Edit: objects in other colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.editing.editor import Masks, objects_in

TURNS = (60.0, 300.0)  # degrees between old and new hue
SATURATIONS, VALUES = (0.35, 0.95), (0.45, 0.95)
COLOURFUL = 0.3  # saturation above which a pixel's relative saturation is kept in full
PATTERN = (0.5, 1.5)  # limits of a pixel's relative saturation, which keeps the object's pattern
GAINS = (0.4, 2.5)  # of brightness


@dataclass(frozen=True)
class Recolour:
    """Gives objects another hue, saturation and brightness inside their masks; shading stays, grey pixels get colour.

    Each object gets a single hue, so that background pixels at its edge do not get a third colour.

    names: of the objects, None for all; colour: red, green, blue (0 .. 255) instead of a random one.
    """

    names: tuple[str, ...] | None = None
    colour: tuple[int, int, int] | None = None

    def __call__(
        self, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None = None
    ) -> np.ndarray:
        """The picture (H, W, 3) uint8 with its objects recoloured.

        Raises: VisionError for a name that the scene does not have.
        """
        out = image.copy()
        for name, drawn in self.draws(masks, rng).items():
            mask = masks[name]
            if mask.any():
                out[mask] = _recoloured(image[mask], **drawn)
        return out

    def draws(self, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
        """For each object: hue, degrees (or "turn", its change in degrees), and mean saturation and value."""
        drawn: dict[str, Any] = {}
        for name in objects_in(masks, self.names):
            turn, saturation, value = (round(float(rng.uniform(*span)), 4) for span in (TURNS, SATURATIONS, VALUES))
            drawn[name] = {"turn": turn, "saturation": saturation, "value": value}
            if self.colour is not None:
                hue, saturation, value = to_hsv(np.array([self.colour], np.uint8))[0].tolist()
                drawn[name] = {"hue": hue, "saturation": saturation, "value": value}
        return drawn


def to_hsv(pixels: np.ndarray) -> np.ndarray:
    """Hue (degrees), saturation and value (0 .. 1) of pixels (n, 3) uint8."""
    return cv2.cvtColor(pixels[None].astype(np.float32) / 255, cv2.COLOR_RGB2HSV)[0]


def from_hsv(hsv: np.ndarray) -> np.ndarray:
    """Pixels (n, 3), float 0 .. 255, of hue (degrees), saturation and value (0 .. 1)."""
    return cv2.cvtColor(hsv[None].astype(np.float32), cv2.COLOR_HSV2RGB)[0] * 255


def _recoloured(
    pixels: np.ndarray, saturation: float, value: float, hue: float | None = None, turn: float = 0.0
) -> np.ndarray:
    """Pixels (n, 3) uint8 of one object in another colour."""
    h, s, v = to_hsv(pixels).T
    angle = np.radians(h)
    middle = float(np.degrees(np.arctan2((s * np.sin(angle)).sum(), (s * np.cos(angle)).sum())))
    wanted = np.full_like(h, (middle + turn if hue is None else hue) % 360)
    own = np.clip(s / COLOURFUL, 0.0, 1.0)
    pattern = np.clip(1 + own * (s / max(float(s.mean()), 1e-3) - 1), *PATTERN)
    gain = np.clip(value / max(float(np.median(v)), 1e-3), *GAINS)
    new = np.stack([wanted, np.clip(saturation * pattern, 0, 1), np.clip(v * gain, 0, 1)], 1)
    return np.clip(np.round(from_hsv(new)), 0, 255).astype(np.uint8)
