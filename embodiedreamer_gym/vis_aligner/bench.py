"""The background of a bench behind robot and objects, and photos of the robot in other poses, from many pictures."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import OBJECT, ROBOT, Bench, Condition, Episode, Gallery, facings
from embodiedreamer_gym.vis_aligner.farthest_points import spread

PICTURES = 240  # of which a pixel's median is taken; more do not change it
EDGE = 1.0 / 128  # of the width: how near to a thing a pixel may be partly that thing
PHOTOS = 40  # of the robot in different poses


def make_bench(episodes: Sequence[Episode]) -> Bench:
    """The background and gallery of episodes before one bench.

    Each pixel of the picture is the median over those in which neither robot nor object is there: the median, because
    shadows pass over every place now and then. The gallery, where the robot's parts are known, has poses that differ.
    Raises: VisionError without an episode, or where sizes differ.
    """
    if len({e.condition.size for e in episodes}) != 1:
        raise VisionError("a bench is known from at least one episode, and from episodes of one size.")
    return Bench(*_behind(episodes), make_gallery(episodes))


def _behind(episodes: Sequence[Episode]) -> tuple[np.ndarray, np.ndarray]:
    """Picture (H, W, 3) of what is behind robot and objects, and where (H, W) that was ever seen."""
    frames = np.concatenate([e.frames for e in episodes])
    free = np.concatenate([_free(e) for e in episodes])
    some = np.unique(np.linspace(0, len(frames) - 1, PICTURES).round().astype(int))
    picture = np.zeros(frames.shape[1:], np.uint8)
    for row in range(len(picture)):
        pixels, background = frames[some, row].astype(np.float32), free[some, row]
        pixels[~background] = np.nan
        covered = background.any(axis=0)
        picture[row, covered] = np.nanmedian(pixels[:, covered], axis=0).round().astype(np.uint8)
    rare = free.any(axis=0) & ~free[some].any(axis=0)  # only in pictures that were left out
    rows, columns = np.nonzero(rare)
    picture[rare] = frames[free.argmax(axis=0)[rare], rows, columns]
    return picture, np.asarray(free.any(axis=0))


def make_gallery(episodes: Sequence[Episode], photos: int = PHOTOS) -> Gallery | None:
    """Pictures in which the robot's parts face the camera in ways that differ most; None where the parts are not known.

    Objects are left out: their numbers mean other things in other tasks.
    """
    with_parts = [e for e in episodes if e.condition.parts is not None and (e.condition.classes == ROBOT).any()]
    if not with_parts:
        return None
    links = max(int(np.max(e.condition.parts[e.condition.classes == ROBOT])) for e in with_parts)  # pyright: ignore[reportOptionalSubscript]
    where = [(e, at) for e in with_parts for at in range(len(e))]
    facing = np.concatenate([facings(e.condition)[:, :links] for e in with_parts])
    taken = [where[k] for k in spread(facing, photos, np.ones(len(where)))]
    views = [e.condition.part(at, at + 1).without_parts(OBJECT) for e, at in taken]
    views = [replace(view, projections=view.projections[:, :links]) for view in views]  # pyright: ignore[reportOptionalSubscript]
    columns = zip(*(vars(view).values() for view in views), strict=True)
    return Gallery(np.stack([e.frames[at] for e, at in taken]), Condition(*map(np.concatenate, columns)))


def with_benches(episodes: Sequence[Episode]) -> list[Episode]:
    """The episodes, each with the bench of all episodes before it; its gallery is of other episodes."""
    groups: dict[str, list[Episode]] = {}
    for episode in episodes:
        groups.setdefault(episode.appearance, []).append(episode)
    made: dict[str, Iterator[Bench]] = {}
    for appearance, those in groups.items():
        behind, halves = _behind(those), (make_gallery(those[1::2]), make_gallery(those[::2]))
        made[appearance] = itertools.cycle([Bench(*behind, gallery) for gallery in halves])
    return [replace(e, bench=next(made[e.appearance])) for e in episodes]


def _free(episode: Episode) -> np.ndarray:
    """Pixels (T, H, W) that show table or background, and no edge of a thing."""
    side = 2 * max(1, round(EDGE * episode.condition.size[0])) + 1
    kernel = np.ones((side, side), np.uint8)
    things = (episode.condition.classes >= ROBOT).astype(np.uint8)
    return np.stack([cv2.dilate(t, kernel) == 0 for t in things])
