"""Edit: table and background in other colours and patterns, or covered with the user's pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.editing.editor import SCENE, Masks
from embodiedreamer_gym.vis_aligner.editing.recolour import from_hsv

PATTERNS = ("plain", "clouds", "stripes", "checks")
HUES = (
    20.0,
    260.0,
)  # degrees; on violet and pink, which it was not trained on, the shipped model leaves spots where objects were
SATURATIONS, VALUES = (0.05, 0.6), (0.35, 0.9)
CONTRASTS = (0.05, 0.25)  # of a pattern
PERIODS = (0.03, 0.15)  # of a pattern, of the picture's width
LIGHT = (0.3, 1.5)  # limits of a pixel's brightness, relative to the median
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


@dataclass(frozen=True)
class Background:
    """Gives table and background another colour and a pattern; light, shadows and grain stay.

    where: table, background or both; pictures: a folder of pictures (png, jpg, bmp) to use instead of colours.
    Raises: VisionError for another name in where, or a folder without pictures.
    """

    where: tuple[str, ...] = ("table", "background")
    pictures: str | Path | None = None

    def __post_init__(self) -> None:
        for name in self.where:
            if name not in SCENE[:2]:
                raise VisionError(f"the background must be {' or '.join(SCENE[:2])}, not '{name}'.")
        if self.pictures is not None:
            self._files()

    def __call__(
        self, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None = None
    ) -> np.ndarray:
        """The picture (H, W, 3) uint8 with another table or background.

        Raises: VisionError where a picture cannot be read.
        """
        out = image.astype(np.float32)
        for name, drawn in self.draws(masks, rng).items():
            mask = masks[name]
            if mask.any():
                new = self._photo(drawn, image) if self.pictures is not None else _pattern(drawn, image)
                out[mask] = (new * light(image, mask)[..., None])[mask]
        return np.clip(np.round(out), 0, 255).astype(np.uint8)

    def draws(self, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
        """For each of where: a picture and whether it is mirrored; or colour, pattern, contrast, period and angle."""
        drawn: dict[str, Any] = {}
        for name in self.where:
            if self.pictures is not None:
                files = self._files()
                drawn[name] = {"picture": files[int(rng.integers(len(files)))].name, "mirrored": bool(rng.integers(2))}
                continue
            hue, saturation, value, contrast, period, angle = (
                round(float(rng.uniform(*span)), 4)
                for span in (HUES, SATURATIONS, VALUES, CONTRASTS, PERIODS, (0, np.pi))
            )
            drawn[name] = {
                "hue": hue, "saturation": saturation, "value": value, "pattern": PATTERNS[int(rng.integers(4))],
                "contrast": contrast, "period": period, "angle": angle, "seed": int(rng.integers(2**31)),
            }  # fmt: skip
        return drawn

    def _files(self) -> list[Path]:
        folder = Path(str(self.pictures))
        files = sorted(p for p in folder.glob("*") if p.suffix.lower() in SUFFIXES)
        if not files:
            raise VisionError(f"{folder} holds no pictures for a background; put {', '.join(SUFFIXES)} files there.")
        return files

    def _photo(self, drawn: dict[str, Any], image: np.ndarray) -> np.ndarray:
        """The drawn picture (H, W, 3), float, scaled and cropped to cover the image."""
        path = Path(str(self.pictures)) / drawn["picture"]
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            raise VisionError(f"{path} is not a readable image; remove it from the folder.")
        height, width = image.shape[:2]
        factor = max(height / picture.shape[0], width / picture.shape[1])
        size = max(width, round(picture.shape[1] * factor)), max(height, round(picture.shape[0] * factor))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)[:height, :width, ::-1]
        return (picture[:, ::-1] if drawn["mirrored"] else picture).astype(np.float32)


def light(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Brightness (H, W) of each pixel relative to the median of a mask: light, shadow and grain."""
    grey = image.astype(np.float32).mean(axis=2)
    return np.clip(grey / max(float(np.median(grey[mask])), 1.0), *LIGHT)


def _pattern(drawn: dict[str, Any], image: np.ndarray) -> np.ndarray:
    """A coloured pattern (H, W, 3), float."""
    height, width = image.shape[:2]
    colour = from_hsv(np.array([[drawn["hue"], drawn["saturation"], drawn["value"]]]))[0]
    rows, columns = np.indices((height, width), np.float32) / width
    period, angle = drawn["period"], drawn["angle"]
    across = np.sin(2 * np.pi * (columns * np.cos(angle) + rows * np.sin(angle)) / period)
    along = np.sin(2 * np.pi * (rows * np.cos(angle) - columns * np.sin(angle)) / period)
    noise = np.random.default_rng(drawn["seed"]).standard_normal((height, width)).astype(np.float32)
    clouds = cv2.GaussianBlur(noise, (0, 0), max(period * width / 4, 0.5))
    patterns = {
        "plain": np.zeros_like(across), "clouds": clouds / (2 * clouds.std() + 1e-6), "stripes": across,
        "checks": np.clip(3 * across * along, -1, 1),
    }  # fmt: skip
    return colour * (1 + drawn["contrast"] * np.clip(patterns[drawn["pattern"]], -1, 1)[..., None])
