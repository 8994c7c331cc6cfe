"""Episodes of a bench drawn in 2-D: small, quick, and their truth is known."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import Condition

WIDTH, HEIGHT = 64, 48
NAMES = ("background", "table", "robot", "cup", "mat")


def texture(seed: int) -> np.ndarray:
    """A real-looking bench without anything on it (H, W, 3), float."""
    rng = np.random.default_rng(seed)
    plain = np.full((HEIGHT, WIDTH, 3), rng.uniform(120, 200, 3), np.float32)
    plain[16:] = rng.uniform(80, 170, 3)
    return plain + cv2.GaussianBlur(rng.normal(0, 30, plain.shape).astype(np.float32), (0, 0), 1.5)


def episode(seed: int = 0, look: int = 0, frames: int = 17, noise: float = 2.0) -> Episode:
    """An arm takes a cup from right to left past a mat; look: of the bench, seed: of places and noise."""
    rng, bench = np.random.default_rng([seed, 1]), texture(look)
    mat, lane = int(rng.integers(8, 20)), int(rng.integers(24, 36))
    real, clean, rgb, classes, depth = [], [], [], [], []
    for i in range(frames):
        x = round(56 - 40 * i / (frames - 1))
        kind = np.zeros((HEIGHT, WIDTH), np.uint8)
        kind[16:] = 1
        cv2.rectangle(kind, (mat, lane), (mat + 10, lane + 6), 4, -1)
        cv2.circle(kind, (x - 3, lane + 2), 3, 3, -1)
        cv2.rectangle(kind, (x, lane - 2), (WIDTH, lane + 3), 2, -1)
        picture = bench.copy()
        picture[lane + 4 : lane + 7, min(x + 2, WIDTH) :] *= 0.75  # the arm's shadow
        for number, colour in ((4, (40, 70, 160)), (3, (190, 40, 35)), (2, (60, 60, 65))):
            picture[kind == number] = colour
        plain = np.array([(214, 216, 220), (209, 196, 176), (120, 120, 125), (200, 80, 60), (40, 92, 158)], np.uint8)
        clean.append(np.clip(picture, 0, 255).astype(np.uint8))
        real.append(np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8))
        rgb.append(plain[kind])
        classes.append(kind)
        depth.append(np.where(kind == 2, 1.0, 1.2).astype(np.float32))
    condition = Condition(np.stack(rgb), np.stack(classes), np.stack(depth))
    return Episode(f"drawn_{seed}", np.stack(real), condition, np.stack(clean), NAMES)
