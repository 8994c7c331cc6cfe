"""Benches for cameras that move with the robot: the table from above, and photos of robot, objects and background."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode, Gallery
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, TABLE, facings
from embodiedreamer_gym.vis_aligner.farthest_points import spread
from embodiedreamer_gym.vis_aligner.object_photos import Photo, photos_of_objects, slim_gallery
from embodiedreamer_gym.vis_aligner.table_atlas import make_table_atlas

ALL = 240  # photos from which the atlas is made
PHOTOS = 14  # of robot and background, from different sides


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
    return Bench(nothing, nothing[..., 0] > 0, _robot(photos), atlas=atlas, things=photos_of_objects(episodes))


def _robot(photos: Sequence[Photo]) -> Gallery:
    """Photos of the robot and the background; the table is in the atlas."""
    links = max(int(np.max(view.parts, where=view.classes <= ROBOT, initial=0)) for _, view in photos)  # pyright: ignore
    sides = np.concatenate([facings(view)[:, :links] for _, view in photos])
    sides *= [np.isin(np.arange(1, links + 1), np.asarray(view.parts))[:, None] for _, view in photos]  # if visible
    taken = spread(sides, PHOTOS, np.ones(len(photos)))
    return slim_gallery(
        [photos[k] for k in taken], links, lambda view: (view.classes != TABLE) & (view.classes < OBJECT)
    )
