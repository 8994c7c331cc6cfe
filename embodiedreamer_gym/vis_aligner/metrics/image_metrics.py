"""PSNR, SSIM, and errors of gradients, of change over time and of colour.

Equal frames count as CEILING dB. PSNR of whole frames is the mean of the frames' PSNR, as in publications. PSNR of a
mask is computed from the mean squared error over all its pixels in the clip, because their number varies from frame to
frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from skimage.metrics import structural_similarity

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_mask, check_pair

CEILING = 100.0  # dB of equal frames, whose mean squared error has no logarithm
WINDOW = 11  # pixels of SSIM's Gaussian window
SIGMA = 1.5  # pixels, its standard deviation


def psnr(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio, dB, of frames (T, H, W, 3), uint8, or of a mask (T, H, W) or (H, W) in them.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    if mask is None:
        return float(psnr_frames(generated, truth).mean())
    squares, counts = _sums(_squares, generated, truth, mask)
    return float(_decibel(float(squares.sum() / (3.0 * counts.sum()))))


def psnr_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Peak signal-to-noise ratio (T,), dB, of each frame; nan where the mask has no pixel.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    squares, counts = _sums(_squares, generated, truth, mask)
    return _decibel(_means(squares, 3.0 * counts))


def ssim(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Structural similarity, at most 1: mean over frames, or over the pixels of a mask with equal weights.

    Raises: VisionError when the clips differ in size or are smaller than the window, or the mask has pixels only within
    5 pixels of the picture's border, where there is no window.
    Source: Wang et al. 2004, equation 13, with the window of their section III-B; the mean over colour channels.
    """
    sums, counts = _sums(_similarity, generated, truth, mask, WINDOW // 2)
    if not counts.any():
        raise VisionError(f"the mask has no pixel further than {WINDOW // 2} from the rim, where SSIM is defined.")
    return float(sums.sum() / counts.sum())


def ssim_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Structural similarity (T,) of each frame; nan where the mask has no pixel.

    Raises: VisionError as `ssim`.
    """
    return _means(*_sums(_similarity, generated, truth, mask, WINDOW // 2))


def gradient_psnr(generated: np.ndarray, truth: np.ndarray) -> float:
    """PSNR, dB, of the differences between neighbouring pixels, along x and y together; mean over frames.

    Blur and grid artefacts lower it; a uniform shift of colour does not. Raises: VisionError when the clips differ in
    size.
    """
    values = []
    for a, b in zip(*check_pair(generated, truth), strict=True):
        error = _difference(a, b)  # the gradient's error is the error's gradient
        steps = np.concatenate([np.diff(error, axis=axis).ravel() for axis in (0, 1)]).astype(np.float64)
        values.append(_decibel(float(np.vdot(steps, steps)) / steps.size) if steps.size else np.nan)
    return float(np.mean(values))


def temporal_error(generated: np.ndarray, truth: np.ndarray) -> float | None:
    """Mean absolute error of the change from frame to frame, 1/255; None for a single frame.

    Sensor noise of standard deviation s in the true frames alone causes an error of 1.13 s.
    Raises: VisionError when the clips differ in size.
    """
    errors = (_difference(a, b) for a, b in zip(*check_pair(generated, truth), strict=True))
    changes = [float(np.abs(after - before).mean()) for before, after in itertools.pairwise(errors)]
    return sum(changes) / len(changes) if changes else None


def colour_shift(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Mean of generated minus true (3,), RGB, 1/255, over all pixels or those of a mask.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    sums, counts = _sums(_difference, generated, truth, mask)
    return sums.sum(axis=0) / counts.sum()


def colour_shift_frames(generated: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Mean of generated minus true (T, 3), RGB, 1/255, of each frame; nan where the mask has no pixel.

    Raises: VisionError when the clips differ in size, or the mask is empty.
    """
    return _means(*_sums(_difference, generated, truth, mask))


def _sums(
    measure: Callable[[np.ndarray, np.ndarray], np.ndarray], generated: np.ndarray, truth: np.ndarray,
    mask: np.ndarray | None, rim: int = 0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Sum over pixels (T, ...) of a measure (H, W, ...) of two frames, and the number of pixels (T,).

    rim: pixels at each border that are left out.
    """
    generated, truth = check_pair(generated, truth)
    height, width = truth.shape[1:3]
    if min(height, width) <= 2 * rim:
        raise VisionError(f"SSIM needs pictures of at least {2 * rim + 1}x{2 * rim + 1}, not {width}x{height}.")
    masks = np.broadcast_to(True, truth.shape[:3]) if mask is None else check_mask(mask, truth)
    inner = (slice(rim, height - rim), slice(rim, width - rim))
    kept = [measure(a, b)[inner][m[inner]] for a, b, m in zip(generated, truth, masks, strict=True)]
    return np.stack([k.sum(axis=0, dtype=np.float64) for k in kept]), np.array([float(len(k)) for k in kept])


def _means(sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Sums (T, ...) divided by counts (T,); nan where the count is 0."""
    counts = np.broadcast_to(counts.reshape(-1, *[1] * (sums.ndim - 1)), sums.shape)
    return np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.subtract(a, b, dtype=np.int16)


def _squares(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared error (H, W), summed over the channels."""
    return np.square(_difference(a, b), dtype=np.int32).sum(axis=2)


def _similarity(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Structural similarity (H, W) of two frames at each pixel, mean over channels."""
    options = {"gaussian_weights": True, "sigma": SIGMA, "use_sample_covariance": False}
    # float64 changes a frame's mean by 5e-6 and takes 2.5 times as long.
    x, y = a.astype(np.float32), b.astype(np.float32)
    return structural_similarity(x, y, data_range=255.0, channel_axis=2, full=True, **options)[1].mean(axis=2)


def _decibel(mean_square: np.ndarray | float) -> np.ndarray:
    floor = 255.0**2 / 10.0 ** (CEILING / 10.0)
    return 10.0 * np.log10(255.0**2 / np.maximum(mean_square, floor))
