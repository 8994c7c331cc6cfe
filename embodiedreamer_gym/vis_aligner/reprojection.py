"""Reprojection: moves the pixels of a picture's rigid parts to where the simulator has moved the parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.clip import Gallery
from embodiedreamer_gym.vis_aligner.condition import Condition, facings

LEVELS = 2  # of 255: simulated colours that differ by at most this much count as equal
STILL = 0.05  # pixels: a part that moves at most this far counts as still
PROBE = 0.1  # m from a part's origin to the points that measure its motion
NEAR = 0.015  # m: depths of the same point of a part differ by less
CHOICES = 2  # photos of a gallery that are tried for each part; the second fills what the first does not show
CHOICES_OF_OBJECT = 6  # of the photos of an object, which may each show a piece of it
FEWEST = 4  # pixels of a part that a photo must show to be used for it
MOST = 30000  # points that OpenCV looks up at once
Reprojected = tuple[np.ndarray, np.ndarray]  # colours (T, H, W, 3) uint8, and where (T, H, W) they are valid


@dataclass(frozen=True, eq=False)
class Change:
    """The difference between a condition of T frames and an earlier condition (T = 1)."""

    before: Condition
    condition: Condition

    @cached_property
    def moved(self) -> np.ndarray:
        """Pixels (T, H, W) of parts that have moved; all False if the parts are not known."""
        if self.condition.parts is None or self.before.parts is None:
            return np.zeros(self.condition.classes.shape, bool)
        return _of_parts(_moved(self.before, self.condition), self.condition.parts)

    @cached_property
    def differs(self) -> np.ndarray:
        """Pixels (T, H, W) whose colour, class or part differs, or whose part has moved."""
        before, now = self.before, self.condition
        apart = np.maximum(now.rgb, before.rgb) - np.minimum(now.rgb, before.rgb) > LEVELS
        differing = apart[..., 0] | apart[..., 1] | apart[..., 2] | (now.classes != before.classes) | self.moved
        return differing if now.parts is None or before.parts is None else differing | (now.parts != before.parts)

    def reproject(self, picture: np.ndarray) -> Reprojected:
        """Colours of parts that have moved, from a picture (H, W, 3) taken at the time of `before`.

        A pixel is filled if that picture shows its point of the part.
        """
        out = nothing(self.condition)
        if self.before.projections is not None:
            numbers = np.zeros(self.before.projections.shape[1], int)
            fill_parts(picture[None], self.before, self.before.projections[0], numbers, self.condition, self.moved, out)
        return out


def reproject_gallery(
    gallery: Gallery | None, condition: Condition, where: np.ndarray | None = None, choices: int = CHOICES
) -> Reprojected:
    """Colours of the parts, each from the photo of a gallery with the most similar viewing direction on the part.

    where (T, H, W) bool: pixels to fill; None for all. choices: number of photos that are tried for each part.
    """
    out = nothing(condition)
    if gallery is None or condition.parts is None or gallery.condition.projections is None:
        return out
    now = facings(condition).mean(axis=0)[: gallery.condition.projections.shape[1]]
    count = len(now)
    alike = np.einsum("klc,lc->kl", gallery.facings[:, :count], now)
    alike[gallery.visible[:, :count] < FEWEST] = -np.inf
    order = np.argsort(-alike, axis=0, kind="stable")
    for numbers in order[:choices]:
        usable = np.isfinite(alike[numbers, np.arange(count)])
        wanted = _of_parts(np.broadcast_to(usable, (len(condition), count)), condition.parts) & ~out[1]
        wanted = wanted if where is None else wanted & where
        projections = gallery.condition.projections[numbers, np.arange(count)]
        fill_parts(gallery.frames, gallery.condition, projections, numbers, condition, wanted, out)
    return out


def reproject_objects(things: Mapping[int, Gallery], condition: Condition, where: np.ndarray) -> Iterator[Reprojected]:
    """Colours of each object that shows at the pixels of `where` (T, H, W) bool, from the photos of it.

    things: photos by class number. `where` may change between two objects.
    """
    for number, photos in things.items():
        if (where & (condition.classes == number)).any() and (view := condition.only(number)) is not None:
            yield reproject_gallery(photos, view, where, CHOICES_OF_OBJECT)


def fill_parts(pictures: np.ndarray, before: Condition, projections: np.ndarray, numbers: np.ndarray, condition: Condition,
               wanted: np.ndarray, out: Reprojected) -> None:  # fmt: skip
    """Fill the wanted pixels (T, H, W) of `out`, in place.

    pictures (K, H, W, 3), before (K frames): source pictures and the simulator's views of them; numbers (L,): the
    picture from which each part is taken; projections (L, 3, 4): of each part in that picture.
    """
    times, rows, columns = np.nonzero(wanted)
    if not len(times):
        return
    parts = condition.parts[times, rows, columns].astype(int) - 1  # pyright: ignore[reportOptionalSubscript]
    turn, shift = _between(projections, np.asarray(condition.projections)[:, : len(projections)])
    depths = _depth(condition)[times, rows, columns]
    rays = np.stack([columns * depths, rows * depths, depths], 1).astype(np.float32)
    points = np.einsum("nij,nj->ni", turn[times, parts], rays) + shift[times, parts]
    away = np.maximum(points[:, 2], 1e-3)
    u, v, photo = points[:, 0] / away, points[:, 1] / away, numbers[parts]
    height, width = pictures.shape[1:3]
    i, j = np.round(v).clip(0, height - 1).astype(int), np.round(u).clip(0, width - 1).astype(int)
    seen = (np.abs(u - j) <= 0.51) & (np.abs(v - i) <= 0.51)
    seen &= before.parts[photo, i, j] == parts + 1  # pyright: ignore[reportOptionalSubscript]
    seen &= np.abs(_depth(before)[photo, i, j] - points[:, 2]) < NEAR
    if seen.any():
        u, v, photo = u[seen], v[seen].clip(0, height - 1), photo[seen]
        out[0][times[seen], rows[seen], columns[seen]] = _sampled(pictures, u, v + photo * height)
        out[1][times[seen], rows[seen], columns[seen]] = True


def _sampled(pictures: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Colours (n, 3), interpolated bilinearly, at column u and row v of pictures stacked one below the other."""
    tall = pictures.reshape(-1, *pictures.shape[2:])
    places = u.astype(np.float32)[:, None], v.astype(np.float32)[:, None]
    taken = [
        cv2.remap(
            tall, places[0][s : s + MOST], places[1][s : s + MOST], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for s in range(0, len(u), MOST)
    ]
    return np.concatenate(taken)[:, 0]


def nothing(condition: Condition) -> Reprojected:
    """An empty result for a condition: no pixel is valid."""
    return np.zeros(condition.rgb.shape, np.uint8), np.zeros(condition.classes.shape, bool)


def _between(before: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (T, L, 3, 3) and shift (T, L, 3): map (u, v, 1) depth in a frame to the same point in another picture."""
    back = before[:, :, :3].astype(float) @ np.linalg.inv(now[..., :3].astype(float))
    shift = before[:, :, 3] - np.einsum("tlij,tlj->tli", back, now[..., 3].astype(float))
    return back.astype(np.float32), shift.astype(np.float32)


def _moved(before: Condition, condition: Condition) -> np.ndarray:
    """Whether each part (T, L) has moved in the picture."""
    probes = np.concatenate([np.zeros((1, 3)), PROBE * np.eye(3)])
    probes = np.concatenate([probes, np.ones((4, 1))], 1).T  # (4, 4)
    then, now = (np.asarray(c.projections, float) @ probes for c in (before, condition))
    then, now = (p[..., :2, :] / np.maximum(np.abs(p[..., 2:, :]), 1e-3) for p in (then, now))
    return np.abs(then - now).max(axis=(2, 3)) > STILL


def _of_parts(which: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Pixels (T, H, W) of the selected parts (T, L); part numbers above L are not selected."""
    table = np.zeros((len(which), 256), np.uint8)
    table[:, 1 : which.shape[1] + 1] = which
    return np.stack([cv2.LUT(part, row) for part, row in zip(parts, table, strict=True)]).astype(bool)


def _depth(condition: Condition) -> np.ndarray:
    return np.zeros(condition.classes.shape) if condition.depth is None else condition.depth
