"""Baseline clips that need no model; every result should be compared with them."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_frames, check_picture, clip_size


def raw_simulation(simulated: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the simulator's own frames (T, H, W, 3), resized to the true ones.

    Raises: VisionError when there is not one for each true frame.
    """
    simulated, truth = check_frames(simulated, "simulated frames"), check_frames(truth, "true frames")
    if len(simulated) != len(truth):
        raise VisionError(
            f"the simulated frames are {clip_size(simulated)}, the true ones {clip_size(truth)}; give one for each."
        )
    if simulated.shape == truth.shape:
        return simulated
    size = truth.shape[2], truth.shape[1]
    how = cv2.INTER_AREA if simulated.shape[2] > size[0] else cv2.INTER_LINEAR
    return np.stack([cv2.resize(frame, size, interpolation=how) for frame in simulated])


def copy_first(reference: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the reference (H, W, 3) once for each true frame (T, H, W, 3), as a read-only view.

    Raises: VisionError when sizes differ.
    """
    truth = check_frames(truth, "true frames")
    return np.broadcast_to(check_picture(reference, truth), truth.shape)


def copy_last(reference: np.ndarray, truth: np.ndarray, chunk: int) -> np.ndarray:
    """Return, for each true frame (T, H, W, 3), the last true frame of the previous chunk.

    The first chunk gets the reference.
    chunk: number of frames generated at once. A model that is given the true last frame must beat this.
    Raises: VisionError when sizes differ or chunk is not above 0.
    """
    truth = check_frames(truth, "true frames")
    first = check_picture(reference, truth)
    if chunk < 1:
        raise VisionError(f"chunk is {chunk}; the number of frames made at once, 1 or more, is expected.")
    starts = np.arange(len(truth)) // chunk * chunk
    copied = truth[np.maximum(starts - 1, 0)]
    copied[:chunk] = first
    return copied
