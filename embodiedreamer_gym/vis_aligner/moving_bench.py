"""Benches for cameras that move with the robot: the table from above, and photos of robot, objects and background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode, Gallery
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, TABLE, Condition, facings
from embodiedreamer_gym.vis_aligner.farthest_points import spread
from embodiedreamer_gym.vis_aligner.table_atlas import make_table_atlas

ALL = 240  # photos from which the atlas is made
PHOTOS = 14  # of robot and background, from different sides
PHOTOS_OF_THING = 8
FEWEST = 15  # pixels of an object that a photo of it must show
EDGE, AROUND = np.ones((3, 3), np.uint8), np.ones((7, 7), np.uint8)
Photo = tuple[np.ndarray, Condition]  # a picture (H, W, 3) and the simulator's view of it, of one frame


def make_moving_bench(episodes: Sequence[Episode]) -> Bench:
    """One bench from the episodes of all cameras that move with the robot, such as both wrist cameras.

    Raises: VisionError without an episode, where sizes differ, or where a camera does not move.
    """
    if len({e.condition.size for e in episodes}) != 1:
        raise VisionError("a bench needs at least one episode, and all episodes must have the same picture size.")
    for episode in episodes:
        if not episode.condition.moving_camera:
            raise VisionError(f"{episode.name}: the camera does not move, or the parts that it sees are not known.")
    photos = [(e.frames[at], e.condition.part(at, at + 1)) for e in episodes for at in range(len(e))]
    nothing = np.zeros(episodes[0].frames.shape[1:], np.uint8)
    some = np.unique(np.linspace(0, len(photos) - 1, ALL).round().astype(int))
    atlas = make_table_atlas(*zip(*(photos[k] for k in some), strict=True))
    return Bench(nothing, nothing[..., 0] > 0, _robot(photos), atlas=atlas, things=_things(episodes))


def _robot(photos: Sequence[Photo]) -> Gallery:
    """Photos of the robot and the background; the table is in the atlas."""
    links = max(int(np.max(view.parts, where=view.classes <= ROBOT, initial=0)) for _, view in photos)  # pyright: ignore
    sides = np.concatenate([facings(view)[:, :links] for _, view in photos])
    sides *= [np.isin(np.arange(1, links + 1), np.asarray(view.parts))[:, None] for _, view in photos]  # if visible
    taken = spread(sides, PHOTOS, np.ones(len(photos)))
    return _gallery([photos[k] for k in taken], links, lambda view: (view.classes != TABLE) & (view.classes < OBJECT))


def _things(episodes: Sequence[Episode]) -> dict[str, Gallery]:
    """Photos of each object, by its name; photos that show more of it are preferred."""
    found = {}
    for name in dict.fromkeys(name for e in episodes for name in e.class_names[OBJECT:]):
        shown: list[tuple[Photo, int]] = []
        for episode in episodes:
            number = episode.class_names.index(name) if name in episode.class_names else -1
            pixels = (episode.condition.classes == number).sum(axis=(1, 2))
            for at in np.flatnonzero(pixels >= FEWEST).tolist():
                view = episode.condition.part(at, at + 1).only(number)
                if view is not None:
                    shown.append(((episode.frames[at], view), int(pixels[at])))
        if shown:
            sides = np.concatenate([facings(view) for (_, view), _ in shown])
            taken = spread(sides, PHOTOS_OF_THING, np.array([float(count) for _, count in shown]))
            found[name] = _gallery([shown[k][0] for k in taken], 1, lambda view: np.asarray(view.parts) > 0)
    return found


def _gallery(photos: Sequence[Photo], parts: int, shown: Callable[[Condition], np.ndarray]) -> Gallery:
    """Photos as a gallery of the first `parts` parts, reduced to the pixels (1, H, W) that `shown` selects in a view.

    The other pixels are zero and need almost no space in a file. Pixels at a part's edge are left out: in a real
    picture, they may show half of something else.
    """
    frames, views = [], []
    for frame, view in photos:
        own, depth, places = (np.asarray(x) for x in (view.parts, view.depth, view.projections))
        kept = shown(view) & (cv2.dilate(own[0], EDGE) == cv2.erode(own[0], EDGE))
        around = cv2.dilate(kept[0].astype(np.uint8), AROUND) > 0  # neighbours, for interpolation
        frames.append(np.where(around[..., None], frame, 0).astype(np.uint8))
        slim = {"rgb": np.zeros_like(view.rgb), "depth": np.where(kept, depth, 0).astype(np.float16),
                "parts": np.where(kept, own, 0), "projections": places[:, :parts], "hulls": None}  # fmt: skip
        views.append(replace(view, **slim))
    return Gallery(np.stack(frames), Condition.joined(views))
