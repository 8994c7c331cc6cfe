"""Pictures and masks scaled to a policy's size."""

from __future__ import annotations

import cv2
import numpy as np


def scaled(frames: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pictures (T, H, W, 3) uint8 scaled to a size (width, height)."""
    if frames.shape[1:3] == size[::-1]:
        return frames
    smaller = frames.shape[2] * frames.shape[1] > size[0] * size[1]
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.stack([cv2.resize(frame, size, interpolation=how) for frame in frames])


def scaled_masks(masks: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Masks (T, H, W) uint8 scaled to a size (width, height)."""
    if masks.shape[1:3] == size[::-1]:
        return masks
    return np.stack([cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST_EXACT) for mask in masks])
