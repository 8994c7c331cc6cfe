"""Camera model of the films: lens distortion, vignetting, exposure, colour response and sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from embodiedreamer_gym.geometry.camera import Camera

NOISE = 2.0  # of 255: standard deviation of the sensor noise per pixel and frame
SHOULDER = 0.62  # of full scale: above it the sensor response is compressed
FINER = 3  # resolution of class images before they are distorted, in multiples of the picture's
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of red, green, blue; source: ITU-R BT.709


@dataclass(frozen=True)
class CameraNoise:
    """Deviations of a camera from an ideal pinhole.

    barrel: radial distortion, relative displacement of a point at unit tangent from the axis (negative: barrel).
    vignette: share of the light lost in the corners.
    blur: standard deviation of the point spread, pixels of a picture 640 wide.
    key: brightness 0..1 to which the empty table is exposed.
    white: gains of red and blue relative to green.
    contrast: 1 is neutral.
    saturation: 1 is neutral.
    haze: share of stray light.
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
class NoisyCamera:
    """Turns renderings of a pinhole camera into pictures of a real one.

    camera: pinhole camera without distortion; size: width and height of the pictures; noise: errors to apply.
    Renderings come from `wide`, a pinhole camera with the same pixel size and a margin for the distortion.
    """

    camera: Camera
    size: tuple[int, int]
    noise: CameraNoise

    @cached_property
    def margin(self) -> tuple[int, int]:
        """Extra pixels of `wide` at the left and right edge, and at the top and bottom edge."""
        (u, v), (width, height) = self._sources, self.size
        x = max(-float(u.min()), float(u.max()) - (width - 1))
        y = max(-float(v.min()), float(v.max()) - (height - 1))
        return int(np.ceil(max(x, 0.0))) + 2, int(np.ceil(max(y, 0.0))) + 2  # 2: neighbours used by interpolation

    @cached_property
    def wide(self) -> Camera:
        """The pinhole camera with the margin; its size is that of the renderings."""
        (fx, _, cx), (_, fy, cy), _ = self.camera.matrix(self.size).tolist()
        x, y = self.margin
        return self.camera.with_(size=(self.size[0] + 2 * x, self.size[1] + 2 * y), fx=fx, fy=fy, cx=cx + x, cy=cy + y)

    @cached_property
    def _sources(self) -> tuple[np.ndarray, np.ndarray]:
        """Undistorted column and row (H, W) that each pixel of the distorted picture shows."""
        (fx, _, cx), (_, fy, cy), _ = self.camera.matrix(self.size).tolist()
        width, height = self.size
        x, y = np.meshgrid((np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy)
        distorted = np.hypot(x, y)
        radius = distorted.copy()
        for _ in range(8):  # Newton steps for radius + barrel * radius^3 = distorted
            slope = 1.0 + 3.0 * self.noise.barrel * radius**2
            radius -= (radius + self.noise.barrel * radius**3 - distorted) / slope
        ratio = np.divide(radius, distorted, out=np.ones_like(distorted), where=distorted > 0.0)
        return x * ratio * fx + cx, y * ratio * fy + cy

    def distort(self, rendering: np.ndarray) -> np.ndarray:
        """Distorted light (H, W, 3), float32, from a rendering (H', W', 3) of `wide`."""
        u, v = self._sources
        x, y = self.margin
        distorted = cv2.remap(
            rendering.astype(np.float32), (u + x).astype(np.float32), (v + y).astype(np.float32), cv2.INTER_CUBIC
        )
        return np.maximum(distorted, 0.0)

    def distort_classes(self, classes: np.ndarray) -> np.ndarray:
        """Distorted classes (H, W) by nearest neighbour, from an image (n H', n W') of `wide`."""
        u, v = self._sources
        x, y = self.margin
        finer = classes.shape[1] / (self.size[0] + 2 * x)
        columns, rows = (np.rint((source + 0.5) * finer - 0.5).astype(int) for source in (u + x, v + y))
        return classes[rows.clip(0, classes.shape[0] - 1), columns.clip(0, classes.shape[1] - 1)]

    @cached_property
    def vignetting(self) -> np.ndarray:
        """Share (H, W, 1) of the light that reaches each pixel."""
        width, height = self.size
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        return (1.0 - self.noise.vignette * (0.5 * (x**2 + y**2)) ** 1.3)[..., None].astype(np.float32)

    def develop(self, light: np.ndarray, exposure: float) -> np.ndarray:
        """Pixel values (H, W, 3), float 0..255, from a rendering (H', W', 3) of `wide`; exposure: sensor gain."""
        noise = self.noise
        white = np.array([noise.white[0], 1.0, noise.white[1]], np.float32)
        distorted = self.distort(light) * self.vignetting * white * exposure
        sigma = noise.blur * self.size[0] / 640.0
        if sigma > 0.2:
            distorted = cv2.GaussianBlur(distorted, (0, 0), sigma)
        return 255.0 * tone_map(distorted, noise)


def tone_map(light: np.ndarray, noise: CameraNoise) -> np.ndarray:
    """Brightness 0..1 of light (..., 3), where 1 saturates a linear sensor.

    Source: sRGB's transfer function, IEC 61966-2-1.
    """
    light = light * (1.0 - noise.haze) + noise.haze * 0.3
    over = np.maximum(light - SHOULDER, 0.0)
    light = np.minimum(light, SHOULDER) + (1.0 - SHOULDER) * -np.expm1(-over / (1.0 - SHOULDER))
    encoded = np.where(light < 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    grey = encoded @ LUMINANCE.astype(encoded.dtype)
    encoded = grey[..., None] + noise.saturation * (encoded - grey[..., None])
    encoded = np.clip(encoded, 0.0, 1.0)
    curved = encoded * encoded * (3.0 - 2.0 * encoded)
    return np.clip(encoded + (noise.contrast - 1.0) * (curved - encoded), 0.0, 1.0)


def auto_exposure(light: np.ndarray, noise: CameraNoise) -> float:
    """Sensor gain that gives light (H, W, 3) the brightness `noise.key`, as a geometric mean (robust to highlights)."""
    mean = float(np.exp(np.log(np.maximum(light @ LUMINANCE, 1e-4)).mean()))
    return noise.key**2.2 / mean


def add_sensor_noise(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pixels (H, W, 3), uint8, with Gaussian sensor noise added to noise-free values 0..255 (H, W, 3)."""
    return to_uint8(pixels + NOISE * rng.standard_normal(pixels.shape))


def to_uint8(pixels: np.ndarray) -> np.ndarray:
    """Values 0..255 rounded and clipped to uint8."""
    return np.rint(np.clip(pixels, 0.0, 255.0)).astype(np.uint8)
