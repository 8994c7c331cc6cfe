"""Makes a bench from many pictures: the background behind robot and objects, and photos of the robot in other poses."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode, Gallery
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, Condition, facings
from embodiedreamer_gym.vis_aligner.farthest_points import spread
from embodiedreamer_gym.vis_aligner.light import Light, unshaded
from embodiedreamer_gym.vis_aligner.light_fit import fit_light
from embodiedreamer_gym.vis_aligner.object_photos import slim_gallery

PICTURES = 240  # largest number for a pixel's median; more do not change it
EDGE = 1.0 / 128  # of the width: within this distance of a thing, a pixel may show part of it
PAIRS = 8  # of consecutive frames of an episode, for the grain
MOVING = 5.0  # times the median difference of two frames, above which something has moved
PHOTOS = 40  # of the robot in different poses
PLACE = "/"  # in the name of an appearance, between the bench and the place of its camera


def make_bench(episodes: Sequence[Episode], elsewhere: Sequence[Episode] = ()) -> Bench:
    """The bench of episodes: background, light, grain, and a gallery of different poses if the robot's parts are known.

    elsewhere: more episodes of the same bench by a camera in other places; only the gallery uses them.

    Each background pixel is the median over the frames in which no robot or object covers it. The median is used
    because shadows pass over every place now and then. If the light is known, shadows on the table are removed first.
    Raises: VisionError without an episode, or where sizes differ.
    """
    if len({e.condition.size for e in (*episodes, *elsewhere)}) != 1 or not episodes:
        raise VisionError("a bench needs at least one episode, and all episodes must have the same picture size.")
    frames, views, links = _photos(episodes)
    light = fit_light(frames, views)
    gallery = make_gallery([*episodes, *elsewhere]) if elsewhere else _gallery(frames, views, links)
    return Bench(*_behind(episodes, light), gallery, light, grain_of(episodes))


def grain_of(episodes: Sequence[Episode]) -> float | None:
    """Standard deviation of the sensor's noise, of 255; None if no two consecutive frames show the background.

    It is computed from differences of consecutive frames at background pixels. Motion, such as of shadows, is left out.
    """
    found = []
    for episode in episodes:
        for at in np.unique(np.linspace(0, max(len(episode) - 2, 0), PAIRS).astype(int))[: len(episode) - 1]:
            free = _free(episode.condition.part(at, at + 2))
            first, second = episode.frames[at : at + 2].astype(np.int16)
            found.append((second - first)[free.all(axis=0)].ravel())
    apart = np.concatenate(found) if found else np.zeros(0)
    if not len(apart):
        return None
    usual = np.abs(apart) <= MOVING * max(float(np.median(np.abs(apart))), 1.0)
    return float(apart[usual].std() / np.sqrt(2))


def _behind(episodes: Sequence[Episode], light: Light | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Background (H, W, 3) behind robot and objects, and where (H, W) it was ever seen.

    If the light is known, the background has no shadows on the table.
    """
    where = [(e, at) for e in episodes for at in range(len(e))]
    free = np.concatenate([_free(e.condition) for e in episodes])
    some = np.unique(np.linspace(0, len(where) - 1, PICTURES).round().astype(int))
    rare = free.any(axis=0) & ~free[some].any(axis=0)  # visible only in pictures that were left out
    first = free.argmax(axis=0)
    frames = {k: _unshaded(where[k][0], where[k][1], light) for k in {*some.tolist(), *first[rare].tolist()}}
    picture = np.zeros(frames[0].shape, np.uint8)
    taken = np.stack([frames[k] for k in some])
    for row in range(len(picture)):
        pixels, background = taken[:, row].astype(np.float32), free[some, row]
        pixels[~background] = np.nan
        covered = background.any(axis=0)
        picture[row, covered] = np.nanmedian(pixels[:, covered], axis=0).round().astype(np.uint8)
    for row, column in np.argwhere(rare):
        picture[row, column] = frames[first[row, column]][row, column]
    return picture, np.asarray(free.any(axis=0))


def _unshaded(episode: Episode, at: int, light: Light | None) -> np.ndarray:
    """A frame (H, W, 3) with the shadows on the table removed, if the light is known."""
    view = episode.condition.part(at, at + 1)
    return unshaded(episode.frames[at], view if light is None else light.on(view))


def make_gallery(episodes: Sequence[Episode], photos: int = PHOTOS) -> Gallery | None:
    """Pictures that show the robot's parts from the most different sides; None if the parts are not known.

    Objects are left out: their numbers have other meanings in other tasks.
    """
    return _gallery(*_photos(episodes, photos))


def make_robot_gallery(episodes: Sequence[Episode]) -> Gallery | None:
    """The same with only the robot's pixels in the photos; they may be larger than the frames that are generated."""
    frames, views, links = _photos(episodes)
    photos = list(zip(frames, views, strict=True))
    return slim_gallery(photos, links, lambda view: view.classes == ROBOT, edges=True) if photos else None


def _photos(episodes: Sequence[Episode], photos: int = PHOTOS) -> tuple[list[np.ndarray], list[Condition], int]:
    """Photos (H, W, 3) of the robot's parts from the most different sides, the simulator's views, and link count."""
    with_parts = [e for e in episodes if e.condition.parts is not None and (e.condition.classes == ROBOT).any()]
    if not with_parts:
        return [], [], 0
    links = max(int(np.max(e.condition.parts[e.condition.classes == ROBOT])) for e in with_parts)  # pyright: ignore[reportOptionalSubscript]
    where = [(e, at) for e in with_parts for at in range(len(e))]
    facing = np.concatenate([facings(e.condition)[:, :links] for e in with_parts])
    taken = [where[k] for k in spread(facing, photos, np.ones(len(where)))]
    return [e.frames[at] for e, at in taken], [e.condition.part(at, at + 1) for e, at in taken], links


def _gallery(frames: Sequence[np.ndarray], views: Sequence[Condition], links: int) -> Gallery | None:
    """Photos as a gallery of the robot's links."""
    if not frames:
        return None
    views = [replace(view.without_parts(OBJECT), hulls=None, rgb=np.zeros_like(view.rgb)) for view in views]
    views = [replace(view, projections=view.projections[:, :links]) for view in views]  # pyright: ignore[reportOptionalSubscript]
    return Gallery(np.stack(frames), Condition.joined(views))


def with_benches(episodes: Sequence[Episode]) -> list[Episode]:
    """The episodes, each with its bench: a background from all episodes of the same appearance, and a gallery.

    The gallery is from other episodes of the same bench, whose camera may be in another place.
    """
    places: dict[str, list[Episode]] = {}
    benches: dict[str, list[Episode]] = {}
    for episode in episodes:
        places.setdefault(episode.appearance, []).append(episode)
        benches.setdefault(bench_of(episode), []).append(episode)
    behind = {name: _behind(those) for name, those in places.items()}
    galleries = {
        name: itertools.cycle([make_gallery(those[1::2]), make_gallery(those[::2])]) for name, those in benches.items()
    }
    return [replace(e, bench=Bench(*behind[e.appearance], next(galleries[bench_of(e)]))) for e in episodes]


def bench_of(episode: Episode) -> str:
    """The bench's name, which is the part of the appearance's name before `PLACE`."""
    return episode.appearance.partition(PLACE)[0]


def _free(condition: Condition) -> np.ndarray:
    """Pixels (T, H, W) that show table or background and are not at the edge of a thing."""
    side = 2 * max(1, round(EDGE * condition.size[0])) + 1
    kernel = np.ones((side, side), np.uint8)
    things = (condition.classes >= ROBOT).astype(np.uint8)
    return condition.free & np.stack([cv2.dilate(t, kernel) == 0 for t in things])
