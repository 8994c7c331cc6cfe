"""Checks the inputs of the metrics: clips of frames, classes and masks of one size."""

from __future__ import annotations

from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError


def check_frames(frames: Any, name: str = "frames") -> np.ndarray:
    """Return frames (T, H, W, 3), uint8 RGB.

    Raises: VisionError for another type or shape, or no frame.
    """
    return _checked(frames, name, "uint8 RGB (T, H, W, 3)", np.uint8, 4, 3)


def check_pair(generated: Any, truth: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return two clips (T, H, W, 3), uint8 RGB, of one length and size.

    Raises: VisionError when they differ in length or size, or one of them is not a clip.
    """
    generated, truth = check_frames(generated, "generated frames"), check_frames(truth, "true frames")
    if generated.shape != truth.shape:
        raise VisionError(
            f"the generated frames are {clip_size(generated)}, the true ones {clip_size(truth)}; they must have the "
            "same length and size."
        )
    return generated, truth


def check_picture(picture: Any, like: np.ndarray) -> np.ndarray:
    """Return a picture (H, W, 3), uint8 RGB, of the size of the frames `like` (T, H, W, 3).

    Raises: VisionError for another type, shape or size.
    """
    array = _checked(picture, "reference", "uint8 RGB (H, W, 3)", np.uint8, 3, 3)
    if array.shape != like.shape[1:]:
        raise VisionError(
            f"the reference is {array.shape[1]}x{array.shape[0]}, the frames are {clip_size(like)}; give one of their size."
        )
    return array


def check_classes(classes: Any, like: np.ndarray, name: str = "classes") -> np.ndarray:
    """Return class numbers (T, H, W), uint8, of the length and size of the frames `like` (T, H, W, 3).

    Raises: VisionError for another type, shape, length or size.
    """
    array = _checked(classes, name, "uint8 (T, H, W)", np.uint8, 3)
    if array.shape != like.shape[:3]:
        raise VisionError(
            f"the {name} are {clip_size(array)}, the frames {clip_size(like)}; give one class picture for each frame."
        )
    return array


def check_mask(mask: Any, like: np.ndarray) -> np.ndarray:
    """Return a mask (T, H, W), bool, for the frames `like` (T, H, W, 3); a single mask (H, W) is used for all frames.

    Raises: VisionError for another type or size, or a mask without a pixel.
    """
    array = np.asarray(mask)
    if array.dtype != bool or array.ndim not in (2, 3):
        raise VisionError(f"the mask is {array.dtype} of shape {array.shape}; bool (T, H, W) or (H, W) is expected.")
    shown = array[None] if array.ndim == 2 else array
    if shown.shape[1:] != like.shape[1:3] or (array.ndim == 3 and len(array) != len(like)):
        raise VisionError(
            f"the mask is {clip_size(shown)}, the frames {clip_size(like)}; give one of their length and size."
        )
    if not array.any():
        raise VisionError("the mask has no pixel; there is nothing to measure, so leave it out or mark at least one.")
    return np.broadcast_to(shown, like.shape[:3])


def clip_size(frames: np.ndarray) -> str:
    """Length and size of a clip as text, for an error message: "8 x 128x96"."""
    return f"{len(frames)} x {frames.shape[2]}x{frames.shape[1]}"


def _checked(given: Any, name: str, wanted: str, kind: type, axes: int, channels: int | None = None) -> np.ndarray:
    array = np.asarray(given)
    fits = array.ndim == axes and (channels is None or array.shape[-1] == channels)
    if array.dtype != kind or not fits:
        raise VisionError(f"{name}: {array.dtype} of shape {array.shape} was given; {wanted} is expected.")
    if not array.size:
        raise VisionError(f"{name}: no frame or no pixel was given (shape {array.shape}); give at least one.")
    return array
