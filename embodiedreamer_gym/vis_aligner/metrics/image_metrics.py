"""How like two clips are, pixel by pixel: PSNR, SSIM, gradients, change in time and colour.

A frame that differs nowhere counts as CEILING dB. PSNR of whole frames is the mean over frames of each frame's, as
publications give it; of a mask it comes from the mean square over all its pixels of the clip, whose number varies from
frame to frame.
"""

from __future__ import annotations

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_mask, check_pair

CEILING = 100.0  # dB of frames that are equal; their mean square error would have no logarithm
WINDOW = 11  # pixels of SSIM's Gaussian window
SIGMA = 1.5  # pixels, its standard deviation


def psnr(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio, dB, of frames (T, H, W, 3), uint8, or of a mask (T, H, W) or (H, W) in them.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    if mask is None:
        return float(psnr_frames(generated, truth).mean())
    squares, counts = _squares(*check_pair(generated, truth), mask)
    return float(_decibel(squares.sum() / counts.sum()))


def psnr_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Peak signal-to-noise ratio (T,), dB, of each frame; nan where the mask has no pixel.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    squares, counts = _squares(*check_pair(generated, truth), mask)
    return _decibel(np.divide(squares, counts, out=np.full(len(squares), np.nan), where=counts > 0))


def ssim(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Structural similarity, at most 1, mean over frames (over pixels of a mask: each counts the same).

    Raises: VisionError when the clips differ in size or are smaller than the window, or the mask is empty within
    the picture's rim of 5 pixels, where there is no window.
    Source: Wang et al. 2004, equation 13, with the window of their section III-B; the mean over colour channels.
    """
    sums, counts = _ssim_sums(generated, truth, mask)
    if not counts.any():
        raise VisionError(f"the mask has no pixel further than {WINDOW // 2} from the rim, where SSIM is defined.")
    return float(sums.sum() / counts.sum())


def ssim_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Structural similarity (T,) of each frame; nan where the mask has no pixel.

    Raises: VisionError as `ssim`.
    """
    sums, counts = _ssim_sums(generated, truth, mask)
    return np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0)


def gradient_psnr(generated: np.ndarray, truth: np.ndarray) -> float:
    """PSNR, dB, of the differences between neighbouring pixels, along x and y together; mean over frames.

    It falls with blur and grids, not with an even shift of colour. Raises: VisionError when the clips differ in size.
    """
    values = []
    for a, b in zip(*check_pair(generated, truth), strict=True):
        error = np.subtract(a, b, dtype=np.int16)  # the difference of differences is the difference's difference
        steps = [np.diff(error, axis=axis).astype(np.float64) for axis in (0, 1)]
        count = sum(step.size for step in steps)
        values.append(_decibel(sum(float(np.vdot(s, s)) for s in steps) / count) if count else np.nan)
    return float(np.mean(values))


def temporal_error(generated: np.ndarray, truth: np.ndarray) -> float | None:
    """Mean absolute error of the change from frame to frame, 1/255; None for a single frame.

    Sensor noise of standard deviation s in the true frames alone makes 1.13 s.
    Raises: VisionError when the clips differ in size.
    """
    clips = check_pair(generated, truth)
    previous, total = None, 0.0
    for a, b in zip(*clips, strict=True):
        error = np.subtract(a, b, dtype=np.int16)
        if previous is not None:
            total += float(np.abs(error - previous).mean())
        previous = error
    return total / (len(clips[0]) - 1) if len(clips[0]) > 1 else None


def colour_shift(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Mean of generated less true (3,), RGB, 1/255, over all pixels or those of a mask.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    sums, counts = _shifts(generated, truth, mask)
    return sums.sum(axis=0) / counts.sum()


def colour_shift_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Mean of generated less true (T, 3), RGB, 1/255, of each frame; nan where the mask has no pixel.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    sums, counts = _shifts(generated, truth, mask)
    shape = np.full(sums.shape, np.nan)
    return np.divide(sums, counts[:, None], out=shape, where=counts[:, None] > 0)


def _squares(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared errors (T,) and how many numbers it is of (T,)."""
    masks = None if mask is None else check_mask(mask, truth)
    squares, counts = np.zeros(len(truth)), np.full(len(truth), truth[0].size, float)
    for i, (a, b) in enumerate(zip(generated, truth, strict=True)):
        if masks is None:
            squares[i] = cv2.norm(a, b, cv2.NORM_L2SQR)
        else:
            counts[i] = 3.0 * np.count_nonzero(masks[i])
            squares[i] = cv2.norm(a, b, cv2.NORM_L2SQR, masks[i].astype(np.uint8))
    return squares, counts


def _decibel(mean_square: np.ndarray | float) -> np.ndarray:
    floor = 255.0**2 / 10.0 ** (CEILING / 10.0)
    return 10.0 * np.log10(255.0**2 / np.maximum(mean_square, floor))


def _ssim_sums(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Sum of SSIM over pixels (T,) and how many there are (T,)."""
    generated, truth = check_pair(generated, truth)
    if min(truth.shape[1:3]) < WINDOW:
        raise VisionError(f"SSIM needs pictures of at least {WINDOW}x{WINDOW}, not {truth.shape[2]}x{truth.shape[1]}.")
    masks = None if mask is None else check_mask(mask, truth)
    rim = WINDOW // 2
    inner = (slice(rim, truth.shape[1] - rim), slice(rim, truth.shape[2] - rim))
    sums, counts = np.zeros(len(truth)), np.zeros(len(truth))
    for i, (a, b) in enumerate(zip(generated, truth, strict=True)):
        similarity = _ssim_map(a, b)[inner]
        kept = similarity if masks is None else similarity[masks[i][inner]]
        sums[i], counts[i] = kept.sum(dtype=np.float64), kept.size
    return sums, counts


def _ssim_map(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Similarity (H, W) of two frames at each pixel, mean over channels."""
    options = {"gaussian_weights": True, "sigma": SIGMA, "use_sample_covariance": False}
    # float64 changes a frame's mean by 5e-6 and takes 2.5 times as long.
    x, y = a.astype(np.float32), b.astype(np.float32)
    return structural_similarity(x, y, data_range=255.0, channel_axis=2, full=True, **options)[1].mean(axis=2)


def _shifts(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Sum of generated less true (T, 3) and how many pixels it is of (T,)."""
    generated, truth = check_pair(generated, truth)
    masks = None if mask is None else check_mask(mask, truth)
    sums, counts = np.zeros((len(truth), 3)), np.full(len(truth), float(truth[0, ..., 0].size))
    for i, (a, b) in enumerate(zip(generated, truth, strict=True)):
        error = np.subtract(a, b, dtype=np.int16)
        kept = error.reshape(-1, 3) if masks is None else error[masks[i]]
        sums[i], counts[i] = kept.sum(axis=0, dtype=np.int64), len(kept)
    return sums, counts
