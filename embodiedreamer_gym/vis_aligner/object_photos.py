"""Photos of objects from which their look is taken when the last frame does not show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.clip import Episode, Gallery
from embodiedreamer_gym.vis_aligner.condition import OBJECT, Condition, facings
from embodiedreamer_gym.vis_aligner.farthest_points import spread

PHOTOS = 8  # of each object, from different sides
FEWEST = 15  # pixels of an object that a photo of it must show
EDGE, AROUND = np.ones((3, 3), np.uint8), np.ones((7, 7), np.uint8)
Photo = tuple[np.ndarray, Condition]  # a picture (H, W, 3) and the simulator's view of it, of one frame


def photos_of_objects(episodes: Sequence[Episode]) -> dict[str, Gallery]:
    """Photos of each object, by its name; photos that show more of it are preferred.

    Objects whose pose the simulator's view does not contain are left out.
    """
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
            taken = spread(sides, PHOTOS, np.array([float(count) for _, count in shown]))
            found[name] = slim_gallery([shown[k][0] for k in taken], 1, lambda view: np.asarray(view.parts) > 0)
    return found


def slim_gallery(
    photos: Sequence[Photo], parts: int, shown: Callable[[Condition], np.ndarray], edges: bool = False
) -> Gallery:
    """Photos as a gallery of the first `parts` parts, reduced to the pixels (1, H, W) that `shown` selects in a view.

    The other pixels are zero and need almost no space in a file. Without `edges`, pixels at a part's edge are left out: in
    a real picture, they may show half of something else.
    """
    frames, views = [], []
    for frame, view in photos:
        own, depth, places = (np.asarray(x) for x in (view.parts, view.depth, view.projections))
        kept = shown(view)
        if not edges:
            kept = kept & (cv2.dilate(own[0], EDGE) == cv2.erode(own[0], EDGE))
        around = cv2.dilate(kept[0].astype(np.uint8), AROUND) > 0  # neighbours, for interpolation
        frames.append(np.where(around[..., None], frame, 0).astype(np.uint8))
        slim = {"rgb": np.zeros_like(view.rgb), "depth": np.where(kept, depth, 0).astype(np.float16),
                "parts": np.where(kept, own, 0), "projections": places[:, :parts], "hulls": None}  # fmt: skip
        views.append(replace(view, **slim))
    return Gallery(np.stack(frames), Condition.joined(views))
