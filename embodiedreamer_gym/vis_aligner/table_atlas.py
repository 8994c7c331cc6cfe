"""A picture of the table from above, made from the pictures of a moving camera, to show the table from any view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.condition import TABLE, Condition
from embodiedreamer_gym.vis_aligner.surfaces import on_plane, part_projection, table_points, warped

STEP = 0.0025  # m: size of a pixel of the atlas on the table
LARGEST = 4.0  # m, longest side of a table
NEAREST = 7  # pictures for the median of a pixel of the atlas, taken from nearest
PICTURES = 120  # from which they are chosen
COARSE = 10  # pixels of the atlas per side of a cell for comparing exposures
FEWEST = 20  # cells that are needed for a full correction of a picture's exposure
ROUNDS = 200  # of fitting exposures and colours in turn
MOST_GAIN = 0.7  # largest logarithm of the ratio of two exposures
DARK = 8.0  # of 255: added to colours, because ratios of dark colours are unreliable
EDGE = np.ones((5, 5), np.uint8)  # neighbourhood in which a pixel may show part of something else


@dataclass(frozen=True, eq=False)
class TableAtlas:
    """A picture of the table from above.

    picture (h, w, 3) uint8; seen (h, w) bool: where it is known; corner (2,): x and y in the world, m, of the first
    pixel's centre; x increases with the columns; height: of the table in the world, m.
    Raises: VisionError where shapes differ or numbers are not finite.
    """

    picture: np.ndarray
    seen: np.ndarray
    corner: np.ndarray
    height: float

    def __post_init__(self) -> None:
        if self.picture.dtype != np.uint8 or self.picture.shape != (*self.seen.shape, 3) or self.corner.shape != (2,):
            raise VisionError(
                "an atlas must be (h, w, 3) uint8 with a mask (h, w) of its known pixels and a corner (2,), not "
                f"{self.picture.shape} {self.picture.dtype}, {self.seen.shape} and {self.corner.shape}."
            )
        if not (np.isfinite(self.corner).all() and np.isfinite(self.height)):
            raise VisionError("an atlas' corner and height must be finite numbers.")

    def __repr__(self) -> str:
        return f"TableAtlas({self.picture.shape[1] * STEP:.2f} x {self.picture.shape[0] * STEP:.2f} m)"

    def shown(self, condition: Condition) -> tuple[np.ndarray, np.ndarray]:
        """Colours (T, H, W, 3) uint8 of the table as a moving camera shows it, and where (T, H, W) they are valid."""
        colours, valid = np.zeros(condition.rgb.shape, np.uint8), np.zeros(condition.classes.shape, bool)
        for number, projection in _table_views(condition):
            back = np.linalg.inv(_from_atlas(projection, self.corner, self.height))
            colours[number] = warped(self.picture, back, condition.size, cv2.INTER_LINEAR)
            known = warped(self.seen.astype(np.uint8), back, condition.size, cv2.INTER_NEAREST) > 0
            valid[number] = known & (condition.classes[number] == TABLE)
        return colours, valid


def make_table_atlas(frames: Sequence[np.ndarray], views: Sequence[Condition]) -> TableAtlas | None:
    """The atlas from pictures (H, W, 3) uint8 and the simulator's views of them (T = 1).

    None if no picture of a moving camera shows the table.
    """
    found = [(frame, view, p) for frame, view in zip(frames, views, strict=True) for _, p in _table_views(view)]
    if not found:
        return None
    points = [table_points(view, projection) for _, view, projection in found]
    height = float(np.median(np.concatenate(points)[:, 2]))
    flat = np.concatenate(points)[:, :2]
    middle = np.median(flat, axis=0)
    low, high = (
        np.clip(np.quantile(flat, q, axis=0), middle - LARGEST / 2, middle + LARGEST / 2) for q in (0.001, 0.999)
    )
    width, tall = (np.ceil((high - low) / STEP).astype(int) + 1).tolist()
    stack, count = np.zeros((NEAREST, tall, width, 3), np.uint8), np.zeros((tall, width), int)
    gains = _exposures(found, low, height, (width // COARSE + 1, tall // COARSE + 1))
    near = np.argsort([float(np.median(view.depth[view.classes == TABLE])) for _, view, _ in found], kind="stable")  # pyright: ignore
    for k in near:
        frame, view, projection = found[k]
        frame, shown = _seen_from_above(frame, view, _from_atlas(projection, low, height), (width, tall))
        here = shown & (count < NEAREST)
        rows, columns = np.nonzero(here)
        stack[count[here], rows, columns] = np.clip(np.round(frame[here] / gains[k]), 0, 255)
        count += here
    picture = np.zeros((tall, width, 3), np.uint8)
    for some in range(1, NEAREST + 1):
        mine = count == some
        picture[mine] = np.median(stack[:some, mine], axis=0).round().astype(np.uint8)
    return TableAtlas(picture, count > 0, low, height)


def _seen_from_above(frame: np.ndarray, view: Condition, matrix: np.ndarray,
                     size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """A picture (H, W, 3) warped to an atlas of a size (width, height), and where (h, w) it shows the table."""
    mask = cv2.erode((view.classes[0] == TABLE).astype(np.uint8), EDGE)
    return warped(frame, matrix, size, cv2.INTER_LINEAR), warped(mask, matrix, size, cv2.INTER_NEAREST) > 0


def _exposures(found: Sequence[tuple[np.ndarray, Condition, np.ndarray]], corner: np.ndarray, height: float,
               size: tuple[int, int]) -> np.ndarray:  # fmt: skip
    """Exposure factors (K, 3) of pictures relative to the atlas.

    They are fitted by least squares, so that a cell has the same colour in all pictures that show it.
    """
    coarse = np.diag([COARSE, COARSE, 1.0])
    seen = [_seen_from_above(frame, view, _from_atlas(p, corner, height) @ coarse, size) for frame, view, p in found]
    colours = np.log(np.stack([frame for frame, _ in seen]) + DARK)
    weight = np.stack([mask for _, mask in seen])[..., None].astype(float)
    gains = np.zeros((len(found), 1, 1, 3))
    for _ in range(ROUNDS):
        common = (weight * (colours - gains)).sum(axis=0) / np.maximum(weight.sum(axis=0), 1.0)
        count = weight.sum(axis=(1, 2), keepdims=True)
        gains = (weight * (colours - common)).sum(axis=(1, 2), keepdims=True) / np.maximum(count, FEWEST)
        gains -= gains.mean(axis=0)
    return np.exp(np.clip(gains, -MOST_GAIN, MOST_GAIN))[:, 0, 0]


def _table_views(condition: Condition) -> Iterator[tuple[int, np.ndarray]]:
    """Number and projection (3, 4), from the world, of each frame in which the table is a part."""
    for number in range(len(condition)):
        projection = part_projection(condition, number, TABLE)
        if projection is not None:
            yield number, projection


def _from_atlas(projection: np.ndarray, corner: np.ndarray, height: float) -> np.ndarray:
    """The map (3, 3) from an atlas' pixels to those of a picture."""
    return on_plane(projection, height) @ np.array([[STEP, 0, corner[0]], [0, STEP, corner[1]], [0, 0, 1]])
