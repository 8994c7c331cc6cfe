"""Frames of a camera that moves with a link, assembled from other pictures without a network.

Table and background are warped by homographies; links and objects are reprojected part by part. What the last frame
does not show comes from the true first frame, else from the table's atlas and the bench's photos, matched in exposure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.aligner import check_batch
from embodiedreamer_gym.vis_aligner.clip import Bench, Gallery, References
from embodiedreamer_gym.vis_aligner.condition import BACKGROUND, ROBOT, TABLE, Condition, facings
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs, reprojected_frames
from embodiedreamer_gym.vis_aligner.reprojection import (
    Change,
    Reprojected,
    fill_parts,
    nothing,
    reproject_gallery,
    reproject_objects,
)
from embodiedreamer_gym.vis_aligner.surfaces import in_front, map_back, part_projection, table_points, warped
from embodiedreamer_gym.vis_aligner.table_atlas import DARK, TableAtlas

PHOTOS = 4  # photos of a gallery that are tried for the background
CHOICES = 6  # photos that are tried for a link; each may show only a piece of it
SMOOTH = 5.0 / 128  # of the width: standard deviation of the blur of exposure ratios
MOST_APART = 0.4  # largest logarithm of the ratio of two exposures
FAINT = 0.01  # weight of the mean exposure ratio, which counts where no common pixel is near
NARROW = 2.5  # pixels: holes this near to what the last frame shows are filled from it, better than from a photo
RADIUS = 3  # pixels: radius of inpainting
EDGE, BESIDE = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)


class AssembledAligner:
    """An aligner without a network, the default for cameras that move."""

    name, chunk = "assembled", 8

    def __repr__(self) -> str:
        return "AssembledAligner()"

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames.

        Raises: VisionError when sizes or lengths differ.
        """
        check_batch(references, conditions)
        lit = [r.lit(c) for r, c in zip(references, conditions, strict=True)]
        return [
            assemble(r, c) if c.moving_camera else reprojected_frames(r, c, Inputs())[0]
            for r, c in zip(references, lit, strict=True)
        ]


def assemble(references: References, condition: Condition) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 that follow the last frame of references, for a condition of a moving camera."""
    before = references.last_condition
    change = Change(before, condition)
    frames = np.repeat(references.last[None], len(condition), axis=0)
    stale = change.differs.copy()
    _take(frames, stale, _carried(references.last, before, condition, stale))
    parts = np.asarray(condition.parts)
    _fill_holes(frames, stale, parts, NARROW)
    if stale.any():
        _take(frames, stale, _carried(references.anchor, references.anchor_condition, condition, stale))
    sources = _sources(references.gallery, references.things, references.atlas, condition, stale)
    for colours, valid in sources if stale.any() else ():
        if (stale & valid).any():
            _match_exposure(colours, valid, frames, ~stale)
            _take(frames, stale, (colours, valid))
    _fill_holes(frames, stale, parts)
    _inpaint(frames, stale)
    return frames


def compose_view(bench: Bench, condition: Condition, class_names: Sequence[str]) -> np.ndarray:
    """A picture (H, W, 3) uint8 of the first frame of a moving camera's condition, from what is known about the bench.

    Gaps are filled from their surroundings. If nothing is known, the picture keeps the simulator's colours.
    class_names: names of the class numbers.
    """
    view = condition.part(0, 1)
    frame, missing = view.rgb.copy(), np.ones(view.classes.shape, bool)
    for source in _sources(bench.gallery, bench.photos_of(class_names), bench.atlas, view, missing):
        _take(frame, missing, source)
    if not missing.all():
        _fill_holes(frame, missing, np.asarray(view.parts))
        _inpaint(frame, missing)
    return frame[0]


def _sources(gallery: Gallery | None, things: Mapping[int, Gallery], atlas: TableAtlas | None, condition: Condition,
             stale: np.ndarray) -> Iterator[Reprojected]:  # fmt: skip
    """Colours from a bench's atlas and photos, one source after the other, for the pixels that are stale by then."""
    if atlas is not None:
        yield atlas.shown(condition)
    if gallery is not None:
        yield reproject_gallery(gallery, condition, stale & (condition.classes >= ROBOT), CHOICES)
    yield from reproject_objects(things, condition, stale)
    if gallery is not None:
        for number in _nearest_photos(gallery, condition):
            far = stale & (condition.classes == BACKGROUND)
            if not far.any():
                break
            yield _carried(gallery.frames[number], gallery.condition.part(number, number + 1), condition, far)


def _nearest_photos(gallery: Gallery, condition: Condition) -> np.ndarray:
    """Numbers of the photos of a gallery with the most similar viewing direction, best first."""
    background = np.asarray(condition.parts)[condition.classes == BACKGROUND]
    part = int(background.max(initial=0)) - 1
    if not 0 <= part < gallery.facings.shape[1]:
        return np.zeros(0, int)
    now = facings(condition)[:, part].mean(axis=0)
    return np.argsort(-(gallery.facings[:, part] @ now), kind="stable")[:PHOTOS]


def _carried(picture: np.ndarray, view: Condition, condition: Condition, where: np.ndarray) -> Reprojected:
    """Colours of pixels (T, H, W), from a picture (H, W, 3) and the simulator's view of it (T = 1).

    Table and background next to the robot are left out: in a real picture, these pixels may mix both.
    """
    out = nothing(condition)
    usable = cv2.dilate((view.classes[0] == ROBOT).astype(np.uint8), BESIDE) == 0
    for kind in (TABLE, BACKGROUND):
        before = part_projection(view, 0, kind)
        wanted = where & (condition.classes == kind)
        if before is None or not wanted.any():
            continue
        height = float(np.median(table_points(view, before)[:, 2])) if kind == TABLE else None
        shown = (usable & (view.classes[0] == kind) & (np.asarray(view.parts)[0] > 0)).astype(np.uint8)
        for number in np.flatnonzero(wanted.any(axis=(1, 2))).tolist():
            now = part_projection(condition, number, kind)
            back = map_back(before, now, height)  # pyright: ignore[reportArgumentType]
            there = warped(shown, back, condition.size, cv2.INTER_NEAREST) > 0
            there &= wanted[number] & in_front(back, condition.size)
            out[0][number][there] = warped(picture, back, condition.size, cv2.INTER_CUBIC)[there]
            out[1][number] |= there
    things = where & (condition.classes >= ROBOT)
    if things.any() and view.projections is not None:
        numbers = np.zeros(view.projections.shape[1], int)
        fill_parts(picture[None], view, view.projections[0], numbers, condition, things, out)
    return out


def _take(frames: np.ndarray, stale: np.ndarray, source: Reprojected) -> None:
    """Copy valid colours to stale pixels, which are then no longer stale."""
    colours, valid = source
    new = stale & valid
    frames[new] = colours[new]
    stale &= ~valid


def _match_exposure(colours: np.ndarray, valid: np.ndarray, frames: np.ndarray, known: np.ndarray) -> None:
    """Match colours (T, H, W, 3), at valid pixels (T, H, W), to the exposure and light of the known pixels of frames.

    The ratio of the two is computed at common pixels and extended to the others by normalised convolution.
    """
    for own, mine, frame, theirs in zip(colours, valid, frames, known, strict=True):
        both = (
            cv2.erode((mine & theirs).astype(np.uint8), EDGE) > 0
        )  # not at edges, where a pixel may show half of something else
        if both.any() and (mine & ~theirs).any():
            weight = both.astype(np.float32)
            ratio = np.log((frame.astype(np.float32) + DARK) / (own.astype(np.float32) + DARK))
            ratio = np.clip(ratio, -MOST_APART, MOST_APART) * weight[..., None]
            near = cv2.GaussianBlur(np.dstack([ratio, weight]), (0, 0), SMOOTH * frame.shape[1])
            mean = ratio[both].mean(axis=0)  # where no common pixel is near
            ratio = (near[..., :3] + FAINT * mean) / (near[..., 3:] + FAINT)
            own[mine] = np.clip(np.round((own[mine] + DARK) * np.exp(ratio[mine]) - DARK), 0, 255)


def _fill_holes(frames: np.ndarray, holes: np.ndarray, parts: np.ndarray, reach: float = np.inf) -> None:
    """Fill holes (T, H, W) of frames (T, H, W, 3) with the nearest pixel, up to reach away, of the same part (T, H, W).

    Filled pixels are removed from holes.
    """
    for frame, missing, part in zip(frames, holes, parts, strict=True):
        for number in np.unique(part[missing]):
            known = (part == number) & ~missing
            if known.any():
                away, nearest = cv2.distanceTransformWithLabels(
                    (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
                )
                mine = missing & (part == number) & (away <= reach)
                colours = np.zeros((int(nearest.max()) + 1, 3), np.uint8)
                colours[nearest[known]] = frame[known]
                frame[mine] = colours[nearest[mine]]
                missing &= ~mine


def _inpaint(frames: np.ndarray, holes: np.ndarray) -> None:
    """Inpaint holes (T, H, W) of frames (T, H, W, 3)."""
    for frame, missing in zip(frames, holes, strict=True):
        if missing.any() and not missing.all():
            frame[:] = cv2.inpaint(frame, missing.astype(np.uint8), RADIUS, cv2.INPAINT_TELEA)
