"""Bad input is refused in one sentence that names what was given and what is expected."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import psnr, ssim
from embodiedreamer_gym.vis_aligner.metrics.checks import (
    check_classes,
    check_frames,
    check_mask,
    check_pair,
    check_picture,
)

FRAMES = np.zeros((4, 24, 32, 3), np.uint8)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (FRAMES / 255.0, "float64"),
        (np.full(FRAMES.shape, np.nan), "uint8 RGB"),
        (FRAMES[0], r"\(24, 32, 3\)"),
        (FRAMES[..., :1], r"\(T, H, W, 3\) is expected"),
        (FRAMES[:0], "at least one"),
    ],
)
def test_what_is_no_clip_is_refused(given: np.ndarray, said: str) -> None:
    with pytest.raises(VisionError, match=said):
        check_frames(given)


def test_clips_of_two_sizes_are_refused_with_both() -> None:
    with pytest.raises(VisionError, match="generated frames are 4 x 32x24, the true ones 3 x 32x24"):
        check_pair(FRAMES, FRAMES[:3])
    with pytest.raises(VisionError, match=r"4 x 32x24.*4 x 16x24"):
        psnr(FRAMES, FRAMES[:, :, ::2])


def test_a_reference_or_classes_of_another_size_are_refused() -> None:
    with pytest.raises(VisionError, match="reference is 16x24, the frames are 4 x 32x24"):
        check_picture(FRAMES[0, :, ::2], FRAMES)
    with pytest.raises(VisionError, match="classes are 3 x 32x24, the frames 4 x 32x24"):
        check_classes(FRAMES[:3, ..., 0], FRAMES)
    with pytest.raises(VisionError, match="int64"):
        check_classes(FRAMES[..., 0].astype(int), FRAMES)


def test_a_mask_is_bool_of_this_size_and_not_empty() -> None:
    one = np.zeros((24, 32), bool)
    with pytest.raises(VisionError, match="no pixel"):
        psnr(FRAMES, FRAMES, one)
    one[3, 4] = True
    assert check_mask(one, FRAMES).sum() == 4
    for bad, said in ((one[:, ::2], "1 x 16x24"), (one.astype(np.uint8), "uint8"), (np.stack([one] * 3), "3 x 32x24")):
        with pytest.raises(VisionError, match=said):
            check_mask(bad, FRAMES)


def test_messages_are_one_sentence() -> None:
    for call in (
        lambda: psnr(FRAMES, FRAMES[:2]),
        lambda: ssim(FRAMES[:, :8], FRAMES[:, :8]),
        lambda: check_frames(3),
    ):
        with pytest.raises(VisionError) as caught:
            call()
        text = str(caught.value)
        assert text.endswith(".") and ". " not in text and "\n" not in text
