"""A bench in 2-D: textured wall and table, a grey arm that carries a red cup onto a blue mat, shadows and noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.vis_aligner.metrics import GroundTruth

NAMES = ("background", "table", "robot", "cup", "mat")
WIDTH, HEIGHT, COUNT = 96, 72, 17
TABLE, ARM, CUP, MAT = (150, 115, 80), (95, 100, 105), (190, 40, 35), (40, 70, 160)


@dataclass(frozen=True)
class Bench:
    """frames (T, H, W, 3) with noise, clean ones without, classes (T, H, W), and the simulator's plain frames."""

    frames: np.ndarray
    clean: np.ndarray
    classes: np.ndarray
    simulated: np.ndarray
    plate: np.ndarray

    @property
    def truth(self) -> GroundTruth:
        """All frames but the first, which is the reference."""
        return GroundTruth(self.frames[1:], self.classes[1:], self.frames[0], self.classes[0], NAMES)


def drawn(plate: np.ndarray, count: int = COUNT) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pictures and classes: the arm comes from the right, meets the cup and takes it to the mat on the left."""
    pictures, classes = [], []
    for i in range(count):
        x = round(84 - 58 * i / (count - 1))  # of the arm's hand
        cup = min(60, x - 4)
        picture, kind = plate.copy(), np.zeros((HEIGHT, WIDTH), np.uint8)
        kind[30:] = 1
        shade = np.zeros((HEIGHT, WIDTH), np.uint8)
        cv2.rectangle(shade, (x + 2, 50), (WIDTH, 56), 1, -1)
        picture[shade > 0] *= 0.7
        for number, colour, corner, opposite in (
            (4, MAT, (14, 50), (31, 61)), (3, CUP, (cup - 4, 44), (cup + 4, 54)), (2, ARM, (x, 40), (WIDTH, 48)),
        ):  # fmt: skip
            cv2.rectangle(kind, corner, opposite, number, -1)
            picture[kind == number] = colour
        pictures.append(cv2.GaussianBlur(picture, (3, 3), 0.5))
        classes.append(kind)
    return pictures, classes


@pytest.fixture(scope="session")
def bench() -> Bench:
    rng = np.random.default_rng(7)
    plain = np.full((HEIGHT, WIDTH, 3), 205.0, np.float32)
    plain[30:] = TABLE
    texture = cv2.GaussianBlur(rng.normal(0, 40, plain.shape).astype(np.float32), (0, 0), 2)
    pictures, classes = drawn(np.clip(plain + texture, 0, 255))
    simulated, _ = drawn(plain)
    clean = np.array(pictures)
    noisy = clean + rng.normal(0, 2, clean.shape)
    bytes_of = lambda x: np.clip(np.round(x), 0, 255).astype(np.uint8)  # noqa: E731
    plate = bytes_of(np.clip(plain + texture, 0, 255))
    return Bench(bytes_of(noisy), bytes_of(clean), np.array(classes), bytes_of(np.array(simulated)), plate)
