"""A lens and a sensor: what turns light into the pixels of a real camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from embodiedreamer_gym.geometry.camera import Camera

NOISE = 2.0  # of 255: standard deviation of the sensor's noise per pixel and frame
SHOULDER = 0.62  # of full light, above which a sensor's response bends
FINER = 3  # times as many pixels across as the picture has, in which classes are warped


@dataclass(frozen=True)
class Lens:
    """What a lens and its sensor do to the light.

    barrel: share by which a point at unit tangent from the axis moves outwards (below 0: a barrel); vignette: light
    lost in the corners; blur: sd in pixels of a picture 640 wide; key: brightness 0..1 to which the empty table is
    exposed; white: gains of red and blue over green; contrast: 1 is neutral; saturation: 1 is neutral; haze: share of
    stray light.
    """

    barrel: float = 0.0
    vignette: float = 0.0
    blur: float = 0.0
    key: float = 0.45
    white: tuple[float, float] = (1.0, 1.0)
    contrast: float = 1.0
    saturation: float = 1.0
    haze: float = 0.0


@dataclass(frozen=True, eq=False)
class Optics:
    """A lens before a camera, for pictures of a size (width, height).

    `wide` is the pinhole camera that sees all that the lens lets in: with the same pixels, and a margin of more of them.
    """

    camera: Camera
    size: tuple[int, int]
    lens: Lens

    @cached_property
    def margin(self) -> tuple[int, int]:
        """Pixels to the left and right, and above and below, that the pinhole's picture has more."""
        (u, v), (width, height) = self._seen, self.size
        x = max(-float(u.min()), float(u.max()) - (width - 1))
        y = max(-float(v.min()), float(v.max()) - (height - 1))
        return int(np.ceil(max(x, 0.0))) + 2, int(np.ceil(max(y, 0.0))) + 2  # 2: what interpolation looks at

    @cached_property
    def wide(self) -> Camera:
        """The pinhole camera with a margin; its own size is that of the pictures to be rendered."""
        (fx, _, cx), (_, fy, cy), _ = self.camera.matrix(self.size).tolist()
        x, y = self.margin
        return self.camera.with_(size=(self.size[0] + 2 * x, self.size[1] + 2 * y), fx=fx, fy=fy, cx=cx + x, cy=cy + y)

    @cached_property
    def _seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows (H, W) of the pinhole's picture that the lens's pixels show."""
        (fx, _, cx), (_, fy, cy), _ = self.camera.matrix(self.size).tolist()
        width, height = self.size
        x, y = np.meshgrid((np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy)
        seen = np.hypot(x, y)
        radius = seen.copy()
        for _ in range(8):  # Newton's: radius + barrel radius^3 = seen
            slope = 1.0 + 3.0 * self.lens.barrel * radius**2
            radius -= (radius + self.lens.barrel * radius**3 - seen) / slope
        share = np.divide(radius, seen, out=np.ones_like(seen), where=seen > 0.0)
        return x * share * fx + cx, y * share * fy + cy

    def bend(self, picture: np.ndarray) -> np.ndarray:
        """The light (H, W, 3) that the lens makes of the wide pinhole's (H', W', 3), float32."""
        u, v = self._seen
        x, y = self.margin
        bent = cv2.remap(
            picture.astype(np.float32), (u + x).astype(np.float32), (v + y).astype(np.float32), cv2.INTER_CUBIC
        )
        return np.maximum(bent, 0.0)

    def bend_classes(self, classes: np.ndarray) -> np.ndarray:
        """Classes (H, W) of the lens's picture, by the nearest pixel of the wide pinhole's (n H', n W')."""
        u, v = self._seen
        x, y = self.margin
        finer = classes.shape[1] / (self.size[0] + 2 * x)
        columns, rows = (
            np.rint((place + 0.5) * finer - 0.5).astype(int) for place in (u + x, v + y)
        )  # fmt: skip
        return classes[rows.clip(0, classes.shape[0] - 1), columns.clip(0, classes.shape[1] - 1)]

    @cached_property
    def fading(self) -> np.ndarray:
        """Share (H, W, 1) of the light that reaches each pixel."""
        width, height = self.size
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        return (1.0 - self.lens.vignette * (0.5 * (x**2 + y**2)) ** 1.3)[..., None].astype(np.float32)

    def develop(self, light: np.ndarray, exposure: float) -> np.ndarray:
        """Pixels (H, W, 3), 0..255, float, of the wide pinhole's light (H', W', 3); exposure: gain of the sensor."""
        lens = self.lens
        seen = self.bend(light) * self.fading * np.array([lens.white[0], 1.0, lens.white[1]], np.float32) * exposure
        sigma = lens.blur * self.size[0] / 640.0
        if sigma > 0.2:
            seen = cv2.GaussianBlur(seen, (0, 0), sigma)
        return 255.0 * tone(seen, lens)


def tone(light: np.ndarray, lens: Lens) -> np.ndarray:
    """Brightness 0..1 of light (..., 3), 1 being what just saturates a sensor without a shoulder.

    Source: sRGB's transfer function, IEC 61966-2-1.
    """
    light = light * (1.0 - lens.haze) + lens.haze * 0.3
    over = np.maximum(light - SHOULDER, 0.0)
    light = np.minimum(light, SHOULDER) + (1.0 - SHOULDER) * -np.expm1(-over / (1.0 - SHOULDER))
    shown = np.where(light < 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    grey = shown @ np.array([0.2126, 0.7152, 0.0722], shown.dtype)
    shown = grey[..., None] + lens.saturation * (shown - grey[..., None])
    shown = np.clip(shown, 0.0, 1.0)
    curved = shown * shown * (3.0 - 2.0 * shown)
    return np.clip(shown + (lens.contrast - 1.0) * (curved - shown), 0.0, 1.0)


def meter(light: np.ndarray, lens: Lens) -> float:
    """Gain that shows a picture (H, W, 3) of light in the lens's key: by its geometric mean, which ignores highlights."""
    grey = light @ np.array([0.2126, 0.7152, 0.0722])
    mean = float(np.exp(np.log(np.maximum(grey, 1e-4)).mean()))
    return lens.key**2.2 / mean


def sense(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pixels (H, W, 3), uint8, of a sensor that would be shown pixels 0..255 (H, W, 3) without its noise."""
    return quantise(pixels + NOISE * rng.standard_normal(pixels.shape))


def quantise(pixels: np.ndarray) -> np.ndarray:
    """Pixels 0..255 as uint8."""
    return np.rint(np.clip(pixels, 0.0, 255.0)).astype(np.uint8)
