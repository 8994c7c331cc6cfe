"""PSNR, SSIM and the rest against their formulas, written out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import (
    colour_shift,
    colour_shift_frames,
    gradient_psnr,
    psnr,
    psnr_frames,
    ssim,
    ssim_frames,
    temporal_error,
)
from embodiedreamer_gym.vis_aligner.metrics.image_metrics import CEILING


def noisy(frames: np.ndarray, sd: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(np.round(frames + rng.normal(0, sd, frames.shape)), 0, 255).astype(np.uint8)


def test_psnr_is_its_formula(bench) -> None:
    other = noisy(bench.clean, 9)
    squares = ((other.astype(float) - bench.clean) ** 2).mean(axis=(1, 2, 3))
    expected = 10 * np.log10(255**2 / squares)
    assert psnr_frames(other, bench.clean) == pytest.approx(expected, abs=1e-9)
    assert psnr(other, bench.clean) == pytest.approx(expected.mean(), abs=1e-9)


def test_psnr_of_a_mask_pools_its_pixels(bench) -> None:
    other, mask = noisy(bench.clean, 9), bench.classes == 3
    mask[4] = False
    error = (other.astype(float) - bench.clean)[mask]
    assert psnr(other, bench.clean, mask) == pytest.approx(10 * np.log10(255**2 / (error**2).mean()), abs=1e-9)
    by_frame = psnr_frames(other, bench.clean, mask)
    assert np.isnan(by_frame[4]) and np.isfinite(np.delete(by_frame, 4)).all()


def test_equal_frames_count_as_the_ceiling(bench) -> None:
    assert psnr(bench.frames, bench.frames) == gradient_psnr(bench.frames, bench.frames) == CEILING
    assert psnr(bench.frames, bench.frames, bench.classes == 2) == CEILING
    assert ssim(bench.frames, bench.frames) == 1.0
    assert temporal_error(bench.frames, bench.frames) == 0.0


def written_out(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """SSIM (H - 10, W - 10) of two single-channel pictures, Wang et al. 2004, equation 13."""
    axis = np.arange(-5, 6)
    window = np.exp(-(axis[:, None] ** 2 + axis**2) / (2 * 1.5**2))
    window /= window.sum()
    mean = lambda z: ndimage.correlate(z, window)[5:-5, 5:-5]  # noqa: E731
    a, b = a.astype(float), b.astype(float)
    ma, mb = mean(a), mean(b)
    va, vb, cov = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    return (2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))


def test_ssim_is_its_formula(bench) -> None:
    other = noisy(bench.clean[:2], 12)
    maps = [
        np.mean([written_out(a[..., c], b[..., c]) for c in range(3)], axis=0)
        for a, b in zip(other, bench.clean[:2], strict=True)
    ]
    assert ssim_frames(other, bench.clean[:2]) == pytest.approx([m.mean() for m in maps], abs=1e-5)
    mask = np.zeros(bench.clean.shape[1:3], bool)
    mask[20:30, 40:60] = True
    expected = np.mean([m[15:25, 35:55] for m in maps])
    assert ssim(other, bench.clean[:2], mask) == pytest.approx(expected, abs=1e-5)


def test_ssim_needs_room_for_its_window() -> None:
    small = np.zeros((1, 10, 30, 3), np.uint8)
    with pytest.raises(VisionError, match="at least 11x11, not 30x10"):
        ssim(small, small)
    rim = np.zeros((20, 30), bool)
    rim[0] = True
    frames = np.zeros((1, 20, 30, 3), np.uint8)
    with pytest.raises(VisionError, match="no pixel further than 5 from the rim"):
        ssim(frames, frames, rim)


def test_gradient_psnr_sees_blur_and_not_a_shift_of_colour(bench) -> None:
    shifted = (bench.clean // 2 + 60).astype(np.uint8)
    truth = (bench.clean // 2).astype(np.uint8)
    assert gradient_psnr(shifted, truth) == CEILING and psnr(shifted, truth) < 15
    blurred = np.stack([cv2.GaussianBlur(f, (0, 0), 1.5) for f in truth])
    assert gradient_psnr(blurred, truth) < 40 < CEILING
    ramp = np.zeros((1, 4, 5, 3), np.uint8)
    ramp[:] = 10 * np.arange(5)[:, None]  # steps of 10 along x alone: 16 of 31 differences
    assert gradient_psnr(ramp, np.zeros_like(ramp)) == pytest.approx(10 * np.log10(255**2 / (100 * 16 / 31)))


def test_temporal_error_is_that_of_changes() -> None:
    truth = np.full((3, 4, 4, 3), 100, np.uint8)
    flickering = truth.copy()
    flickering[1] += 6
    assert temporal_error(flickering, truth) == pytest.approx(6.0)
    assert temporal_error(truth + np.uint8(50), truth) == 0.0  # an even shift does not flicker
    assert temporal_error(truth[:1], truth[:1]) is None


def test_temporal_error_of_noise_alone_is_as_documented() -> None:
    clean = np.full((8, 60, 80, 3), 120, np.uint8)
    assert temporal_error(clean, noisy(clean, 2.0)) == pytest.approx(1.13 * 2.0, rel=0.02)


def test_colour_shift_has_a_sign_and_a_channel() -> None:
    truth = np.full((2, 6, 8, 3), 100, np.uint8)
    shifted = truth.copy()
    shifted[..., 0] += 5
    shifted[1, ..., 2] -= 4
    assert colour_shift(shifted, truth) == pytest.approx([5, 0, -2])
    mask = np.zeros((2, 6, 8), bool)
    mask[1, 2] = True
    assert colour_shift(shifted, truth, mask) == pytest.approx([5, 0, -4])
    by_frame = colour_shift_frames(shifted, truth, mask)
    assert np.isnan(by_frame[0]).all() and by_frame[1] == pytest.approx([5, 0, -4])
