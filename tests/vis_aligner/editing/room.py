"""A drawn room with a table, an arm, a cup and a mat, and what is where in it."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import Condition
from tests.vis_aligner.scenes import HEIGHT, NAMES, WIDTH, texture

CUP, MAT, ARM = ((26, 32), (20, 26)), ((34, 40), (8, 18)), ((22, 30), (48, 64))  # rows, columns
COLOURS = {"robot": (60, 60, 65), "cup": (200, 200, 200), "mat": (40, 70, 160)}


def classes(cup: bool = True, arm: bool = True) -> np.ndarray:
    """Class numbers (H, W); the table is all below row 16."""
    out = np.zeros((HEIGHT, WIDTH), np.uint8)
    out[16:] = 1
    for number, ((top, bottom), (left, right)) in ((4, MAT), (3, CUP), (2, ARM)):
        if (number != 3 or cup) and (number != 2 or arm):
            out[top:bottom, left:right] = number
    return out


def picture(seen: np.ndarray) -> np.ndarray:
    """A photo (H, W, 3) of the room: its things' upper half is in the light."""
    bench = texture(0)
    for number, name in enumerate(NAMES):
        if name in COLOURS:
            rows, columns = np.nonzero(seen == number)
            if len(rows):
                shade = np.where(rows < np.median(rows), 1.0, 0.7)[:, None]
                bench[rows, columns] = np.array(COLOURS[name], np.float32) * shade
    return np.clip(bench, 0, 255).astype(np.uint8)


def masks(seen: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """By name."""
    seen = classes() if seen is None else seen
    return {name: seen == number for number, name in enumerate(NAMES)}


def references() -> References:
    """Of the room with all things; its bench is known where they are not, and behind the cup."""
    seen = classes()
    condition = Condition(np.full((1, HEIGHT, WIDTH, 3), 128, np.uint8), seen[None])
    start = References.start(picture(seen), condition)
    known = start.seen | (seen == 3)
    plate = np.where(known[..., None], picture(np.where(seen > 1, 1, seen)), 0).astype(np.uint8)
    return References(start.last, condition, start.anchor, condition, plate, known)
