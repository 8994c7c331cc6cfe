"""Masks of the objects in real frames: from pictures in a folder, from a function, or by colour."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.condition import OBJECT

LARGEST = 9  # largest class number of a mask


class MaskSource(Protocol):
    """Classes (H, W) uint8 of a frame (H, W, 3) uint8: 3 the object, 4 the goal, 0 elsewhere."""

    def __call__(self, frame: np.ndarray, number: int) -> np.ndarray:
        """Classes of frame `number`."""
        ...


def masks_in(folder: str | Path) -> MaskSource:
    """Masks from pictures 000000.png, 000001.png, ..., whose grey levels are class numbers: 0, 3 and 4.

    Raises: VisionError where the folder is missing; when the source is called, where a picture is missing.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise VisionError(f"mask folder {folder} does not exist; it holds 000000.png, 000001.png, ... of one episode.")

    def read(frame: np.ndarray, number: int) -> np.ndarray:
        path = folder / f"{number:06d}.png"
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            raise VisionError(f"{path}: there is no such mask; every frame needs one.")
        return checked(mask, frame, str(path))

    return read


def masks_by(function: Callable[[np.ndarray], np.ndarray]) -> MaskSource:
    """Masks from a function of the frame alone: (H, W, 3) uint8 -> (H, W) class numbers."""
    return lambda frame, number: checked(np.asarray(function(frame)), frame, f"mask of frame {number}")


def no_masks(frame: np.ndarray, number: int) -> np.ndarray:
    """An empty mask for any frame."""
    return np.zeros(frame.shape[:2], np.uint8)


def checked(classes: np.ndarray, frame: np.ndarray, where: str) -> np.ndarray:
    """Classes (H, W) as uint8, checked against their frame.

    Raises: VisionError for another size, or numbers that are not classes of objects.
    """
    if classes.shape != frame.shape[:2]:
        raise VisionError(f"{where} has shape {classes.shape}, its frame {frame.shape[:2]}; they must agree.")
    wrong = sorted(set(np.unique(classes).tolist()) - {0, *range(OBJECT, LARGEST + 1)})
    if wrong:
        raise VisionError(f"{where} holds {wrong[:5]}; allowed are 0 (no object), {OBJECT} (the object), 4 (the goal).")
    return classes.astype(np.uint8)


def coloured(prompts: dict[int, tuple[tuple[int, int, int], tuple[int, int, int]]]) -> MaskSource:
    """Masks by colour: class -> lower and upper bound in OpenCV's HSV; only the largest spot of each is kept.

    This is enough for a red cup on a wooden table; harder scenes need a segmentation model.
    """

    def find(frame: np.ndarray, number: int) -> np.ndarray:
        hsv = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)
        out = np.zeros(frame.shape[:2], np.uint8)
        for value, (low, high) in sorted(prompts.items(), reverse=True):
            spots = cv2.inRange(hsv, np.array(low), np.array(high))
            count, labels, stats, _ = cv2.connectedComponentsWithStats(spots)
            if count > 1:
                out[labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))] = value
        return out

    return find
