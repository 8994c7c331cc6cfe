"""Regions of pixels for the metrics: moving pixels, each class, and static background.

They depend on the true frames alone, so that every model and baseline is scored on the same pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_classes, check_frames, check_picture

ROBOT = 2  # class number; background (0) and table (1) are below it, the task's props above
MOVED = 12.0  # 1/255: a larger difference, averaged over 3x3 pixels, is a change; 13 sd of a sensor's noise of 2/255
SHADOW = (0.4, 2.5)  # times the median colour: in a shadow, or lit where the median is in a shadow
AROUND = 0.03  # of the picture's width: distance to robot and props within which pixels are not checked
PICTURES = 40  # of a clip, for the background's median
MARGIN = 0.015  # of the picture's width, by which moving regions are widened


def moving_region(
    truth: np.ndarray, classes: np.ndarray, reference: np.ndarray, reference_classes: np.ndarray
) -> np.ndarray:
    """Pixels (T, H, W), bool, of true frames that differ from the reference frame.

    A pixel differs if its class does, or if a channel, averaged over 3x3 pixels, differs by more than MOVED. The region
    is widened by a disc of radius MARGIN x width (at least one pixel). It includes shadows, but not noise.
    truth: (T, H, W, 3) and classes (T, H, W), uint8; reference: (H, W, 3) and its classes (H, W), the first frame.
    Raises: VisionError when sizes differ.
    """
    truth = check_frames(truth, "true frames")
    classes = check_classes(classes, truth)
    before = cv2.blur(check_picture(reference, truth), (3, 3))
    first = check_classes(np.asarray(reference_classes)[None], truth[:1], "classes of the reference")[0]
    radius = max(1, round(MARGIN * truth.shape[2]))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    moved = np.empty(truth.shape[:3], bool)
    for i, frame in enumerate(truth):
        changed = (cv2.absdiff(cv2.blur(frame, (3, 3)), before).max(axis=2) > MOVED) | (classes[i] != first)
        moved[i] = cv2.dilate(changed.astype(np.uint8), disc) > 0
    return moved


def unclassed_region(frames: np.ndarray, classes: np.ndarray) -> np.ndarray:
    """Pixels (T, H, W), bool, of true frames that show something moving that is neither robot nor prop.

    A background pixel, averaged over 3x3 pixels, belongs to it if a channel differs by more than MOVED from the median
    of the frames without robot or props there, also after scaling all channels alike, as a shadow does. Pixels within
    AROUND of robot or props are left out, because outlines may be inexact. Grey things in front of grey are missed.
    frames: (T, H, W, 3) and classes (T, H, W), uint8.
    Raises: VisionError when sizes differ.
    """
    frames = check_frames(frames, "true frames")
    things = (check_classes(classes, frames) >= ROBOT).astype(np.uint8)
    side = 2 * max(1, round(AROUND * frames.shape[2])) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    free = np.stack([cv2.dilate(one, kernel) == 0 for one in things])
    some = np.unique(np.linspace(0, len(frames) - 1, PICTURES).round().astype(int))
    soft = np.stack([cv2.blur(frame, (3, 3)) for frame in frames[some]]).astype(np.float32)
    behind = np.ma.median(np.ma.masked_array(soft, np.repeat(~free[some][..., None], 3, axis=3)), axis=0)
    known, behind = ~np.ma.getmaskarray(behind)[..., 0], np.asarray(np.ma.filled(behind, 0.0), np.float32)
    found = np.empty(free.shape, bool)
    for i, frame in enumerate(frames):
        now = cv2.blur(frame, (3, 3)).astype(np.float32)
        scale = (now * behind).sum(axis=2) / np.maximum((behind * behind).sum(axis=2), 1.0)
        shaded = behind * np.clip(scale, *SHADOW)[..., None]
        found[i] = free[i] & known & (np.abs(now - shaded).max(axis=2) > MOVED)
    return found


def static_background(classes: np.ndarray, reference_classes: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Pixels (T, H, W), bool, that show background or table, also in the reference, and do not move.

    Raises: VisionError when sizes differ.
    """
    if classes.shape != moving.shape or np.shape(reference_classes) != classes.shape[1:]:
        raise VisionError(
            f"classes are {classes.shape}, those of the reference {np.shape(reference_classes)}, what moves is "
            f"{moving.shape}; (T, H, W), (H, W) and (T, H, W) of one size are expected."
        )
    return (classes < ROBOT) & (reference_classes < ROBOT) & ~moving


def numbers_of(class_names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Class numbers by region: the robot, each prop, all props as "objects", and "arm and objects".

    class_names: of the class numbers: background, table, robot, then the props.
    Raises: VisionError for fewer than three names, a repeated name, or the name of a region.
    """
    names = tuple(class_names)
    regions = ("objects", "arm and objects", "moving")
    if len(names) <= ROBOT or len(set(names)) < len(names) or set(names) & set(regions):
        raise VisionError(
            f"class names {list(names)}: background, table, robot and the props are expected, each once, "
            f"and none called {', '.join(regions)}."
        )
    props = tuple(range(ROBOT + 1, len(names)))
    numbers = {name: (number,) for number, name in enumerate(names) if number >= ROBOT}
    return numbers | ({"objects": props} if props else {}) | {"arm and objects": (ROBOT, *props)}
