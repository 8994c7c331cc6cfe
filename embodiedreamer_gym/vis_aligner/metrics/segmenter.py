"""Segments pictures into classes by colour, as learnt from true frames and their masks.

Each class is a density over Lab colours. Background and table also have their own colour at each pixel (the plate; the
camera does not move), lit or in shade. A colour of no learnt class is UNKNOWN. Robot and props are searched only near
their places in the clip. Where colours are ambiguous, the true place decides; it changes a class's weight by at most 1
: FAR.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_classes, check_frames, clip_size
from embodiedreamer_gym.vis_aligner.metrics.regions import ROBOT

UNKNOWN = 255  # class number of a colour that no class has
ENOUGH = 100  # largest number of frames to learn from
BINS = 64  # per axis of 8-bit Lab
GREY = np.array([0.0, 128.0, 128.0], np.float32)  # black in 8-bit Lab, towards which a shadow moves a colour
WIDTHS = np.array([8.0, 5.0, 5.0], np.float32)  # 8-bit Lab: sd of a colour around a learnt one
SHADES = (1.0, 0.85, 0.7, 0.55)  # light that a shadow may leave on the background
UNIFORM = 1.0 / (0.2 * 256.0**3)  # density of UNKNOWN: uniform over the fifth of the Lab cube that RGB covers
NEAR = 0.06  # of the picture's width: distance from a class's places within which it is searched
FAR = 0.3  # weight of a class far from its true place; 1 at its place
FADE = 0.008  # of the picture's width: distance over which the weight falls by a factor e
SMOOTHING = (1 / 6, 4 / 6, 1 / 6)  # kernel that smooths the classes' probabilities


@dataclass(frozen=True, eq=False, repr=False)
class Segmenter:
    """Colours of the classes in one scene.

    numbers: learnt classes, 0 for background and table together; densities (n, 64, 64, 64): density of each class per
    unit of 8-bit Lab; plate (H, W, 3), 8-bit Lab: the background at each pixel; known (H, W), bool: where it was seen.
    """

    numbers: tuple[int, ...]
    densities: np.ndarray
    plate: np.ndarray
    known: np.ndarray

    def __repr__(self) -> str:
        return f"Segmenter(classes {', '.join(map(str, self.numbers))}, {self.known.shape[1]}x{self.known.shape[0]})"

    @staticmethod
    def learn(frames: np.ndarray, classes: np.ndarray) -> Segmenter:
        """Learn from true frames (T, H, W, 3), uint8 RGB, of a camera that does not move, and their classes (T, H, W).

        Of more than ENOUGH frames, an evenly spread subset is used.
        Raises: VisionError when sizes differ, or no pixel is background or table.
        """
        frames = check_frames(frames)
        classes = check_classes(classes, frames)
        step = -(-len(frames) // ENOUGH)
        frames, merged = frames[::step], np.where(classes[::step] < ROBOT, 0, classes[::step])
        numbers = tuple(int(n) for n in np.unique(merged))
        if numbers[0] != 0:
            raise VisionError(
                "no pixel of the classes is background (0) or table (1); a segmenter must see some of it."
            )
        counts = np.zeros((len(numbers), BINS**3))
        for frame, mask in zip(frames, merged, strict=True):
            bins = _bins(_lab(frame))
            for i, number in enumerate(numbers):
                counts[i] += np.bincount(bins[mask == number], minlength=BINS**3)
        side = 256.0 / BINS
        cubes = counts.reshape(-1, BINS, BINS, BINS) / counts.sum(axis=1)[:, None, None, None] / side**3
        densities = np.stack([ndimage.gaussian_filter(cube.astype(np.float32), WIDTHS / side) for cube in cubes])
        return Segmenter(numbers, densities, *_plate(frames, merged == 0))

    def segment(self, frames: np.ndarray, classes: np.ndarray, more: np.ndarray | None = None) -> np.ndarray:
        """Classes (T, H, W), uint8, of frames (T, H, W, 3): 0 for background and table, UNKNOWN for none.

        classes: true ones (T, H, W); more: classes (H, W) of another frame, e.g. the reference, near which robot and
        props are searched too.
        Raises: VisionError for another size than the learnt one, or a class that was not learnt.
        """
        frames = check_frames(frames)
        classes = check_classes(classes, frames)
        if frames.shape[1:3] != self.known.shape:
            height, width = self.known.shape
            raise VisionError(
                f"the frames are {clip_size(frames)}, the segmenter was trained on {width}x{height}; give that size."
            )
        areas = search_areas(classes, more)
        if unlearnt := sorted(set(areas) - set(self.numbers)):
            raise VisionError(
                f"classes {unlearnt} are unknown to the segmenter; it was trained only on {list(self.numbers)}."
            )
        labels = np.array([0, *areas, UNKNOWN], np.uint8)
        segmented = np.empty(classes.shape, np.uint8)
        for i, frame in enumerate(frames):
            segmented[i] = labels[self._shares(_lab(frame), classes[i], areas).argmax(axis=2)]
        return segmented

    def _shares(self, lab: np.ndarray, classes: np.ndarray, areas: dict[int, np.ndarray]) -> np.ndarray:
        """Probabilities (H, W, classes + 2) of background, the classes of `areas` and UNKNOWN at each pixel."""
        bins = _bins(lab)
        density = dict(zip(self.numbers, self.densities.reshape(len(self.numbers), -1), strict=True))
        scores = [self._background(lab, density[0][bins]) * _weight(classes < ROBOT)]
        scores += [density[n][bins] * _weight(classes == n) * area for n, area in areas.items()]
        shares = np.stack([*scores, np.full(bins.shape, UNIFORM)], axis=2).astype(np.float32)
        shares /= shares.sum(axis=2, keepdims=True)
        return cv2.sepFilter2D(shares, -1, np.array(SMOOTHING), np.array(SMOOTHING))

    def _background(self, lab: np.ndarray, anywhere: np.ndarray) -> np.ndarray:
        """Density (H, W) of background: the mean of the pixel's own, in several shades, and that of all pixels."""
        plate, colour = ((x.astype(np.float32) - GREY) / WIDTHS for x in (self.plate, lab))
        square, product = (np.einsum("hwc,hwc->hw", x, plate) for x in (plate, colour))
        rest = np.einsum("hwc,hwc->hw", colour, colour)
        own = sum(np.exp(np.minimum(0.0, shade * product - 0.5 * (rest + shade**2 * square))) for shade in SHADES)
        own /= len(SHADES) * (2.0 * np.pi) ** 1.5 * np.prod(WIDTHS)
        return np.where(self.known, 0.5 * (own + anywhere), anywhere)


def search_areas(classes: np.ndarray, more: np.ndarray | None = None) -> dict[int, np.ndarray]:
    """Search area of each robot or prop class: class number -> (H, W), bool.

    All pixels of the class in any of classes (T, H, W) or in `more` (H, W), widened by a disc of radius NEAR x width.
    An object that is drawn at an earlier place thus lowers the IoU as much as one beside its true place.
    """
    radius = max(1, round(NEAR * classes.shape[2]))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    areas = {}
    for number in range(ROBOT, max(int(classes.max()), 0 if more is None else int(np.max(more))) + 1):
        place = (classes == number).any(axis=0)
        place |= False if more is None else np.asarray(more) == number
        if place.any():
            areas[number] = cv2.dilate(place.astype(np.uint8), disc) > 0
    return areas


def overlaps(segmented: np.ndarray, classes: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of pixels in intersection (T,) and union (T,) of a class in segmented and true classes (T, H, W).

    Raises: VisionError when sizes differ.
    """
    if segmented.shape != classes.shape:
        raise VisionError(
            f"found classes are {segmented.shape}, true ones {classes.shape}; (T, H, W) of one size is expected."
        )
    both, either = np.zeros(len(classes)), np.zeros(len(classes))
    for i in range(len(classes)):
        a, b = segmented[i] == number, classes[i] == number
        both[i], either[i] = np.count_nonzero(a & b), np.count_nonzero(a | b)
    return both, either


def mask_iou(segmented: np.ndarray, classes: np.ndarray, number: int) -> float:
    """Intersection over union of a class in segmented and true classes (T, H, W), over all pixels of the clip.

    Raises: VisionError when sizes differ, or neither has a pixel of the class.
    """
    both, either = overlaps(segmented, classes, number)
    if not either.any():
        raise VisionError(f"no pixel has class {number}; leave it out.")
    return float(both.sum() / either.sum())


def _lab(frame: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(frame, cv2.COLOR_RGB2Lab)


def _bins(lab: np.ndarray) -> np.ndarray:
    """Index (H, W) into a flattened cube of colours."""
    parts = lab.astype(np.int32) // (256 // BINS)
    return (parts[..., 0] * BINS + parts[..., 1]) * BINS + parts[..., 2]


def _weight(place: np.ndarray) -> np.ndarray:
    """Weight (H, W) of a class by the distance from its true place (H, W)."""
    if not place.any():
        return np.full(place.shape, FAR, np.float32)
    distance = cv2.distanceTransform((~place).astype(np.uint8), cv2.DIST_L2, 5)
    return np.maximum(FAR, np.exp(-distance / (FADE * place.shape[1])))


def _plate(frames: np.ndarray, background: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lab colour (H, W, 3) of the background at each pixel, and where (H, W) it was seen.

    It is the mean over time, computed again from colours near the first mean, to leave out passing shadows.
    """
    mean, seen = np.zeros(frames.shape[1:], np.float32), np.zeros(frames.shape[1:3], bool)
    for near in (np.inf, 25.0):
        total, count = np.zeros(frames.shape[1:]), np.zeros(frames.shape[1:3])
        for frame, mask in zip(frames, background, strict=True):
            lab = _lab(frame).astype(np.float32)
            kept = mask & (np.abs(lab - mean).max(axis=2) <= near)
            total[kept] += lab[kept]
            count += kept
        seen |= count > 0
        mean = np.where(count[..., None] > 0, total / np.maximum(count, 1)[..., None], mean).astype(np.float32)
    return mean, seen
