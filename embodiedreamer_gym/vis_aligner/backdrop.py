"""A bench without robot and objects, from many pictures in which they stand in different places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import ROBOT, Backdrop, Episode

PICTURES = 240  # of which a pixel's median is taken; more tell no more
EDGE = 1.0 / 128  # of the width: how near to a thing a pixel may be partly that thing


def make_backdrop(episodes: Sequence[Episode]) -> Backdrop:
    """The median of each pixel over the pictures in which neither robot nor object is there.

    The median, because shadows pass over every place now and then.
    Raises: VisionError without an episode, or where sizes differ.
    """
    if len({e.condition.size for e in episodes}) != 1:
        raise VisionError("a backdrop is made of at least one episode, all of one size.")
    frames = np.concatenate([e.frames for e in episodes])
    free = np.concatenate([_free(e) for e in episodes])
    some = np.unique(np.linspace(0, len(frames) - 1, PICTURES).round().astype(int))
    picture = np.zeros(frames.shape[1:], np.uint8)
    for row in range(len(picture)):
        pixels, known = frames[some, row].astype(np.float32), free[some, row]
        pixels[~known] = np.nan
        there = known.any(axis=0)
        picture[row, there] = np.nanmedian(pixels[:, there], axis=0).round().astype(np.uint8)
    rare = free.any(axis=0) & ~free[some].any(axis=0)  # only in pictures that were left out
    rows, columns = np.nonzero(rare)
    picture[rare] = frames[free.argmax(axis=0)[rare], rows, columns]
    return Backdrop(picture, np.asarray(free.any(axis=0)))


def with_backdrops(episodes: Sequence[Episode]) -> list[Episode]:
    """The episodes, each with the backdrop that all those before its bench give."""
    benches = {e.bench: [other for other in episodes if other.bench == e.bench] for e in episodes}
    made = {bench: make_backdrop(those) for bench, those in benches.items()}
    return [replace(e, backdrop=made[e.bench]) for e in episodes]


def _free(episode: Episode) -> np.ndarray:
    """Pixels (T, H, W) that show table or background, and no edge of a thing."""
    side = 2 * max(1, round(EDGE * episode.condition.size[0])) + 1
    kernel = np.ones((side, side), np.uint8)
    things = (episode.condition.classes >= ROBOT).astype(np.uint8)
    return np.stack([cv2.dilate(t, kernel) == 0 for t in things])
