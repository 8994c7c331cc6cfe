"""The clips that know nothing, frame by frame."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import copy_first, copy_last, raw_simulation

TRUTH = np.arange(1, 8, dtype=np.uint8)[:, None, None, None] * np.ones((1, 4, 6, 3), np.uint8)  # frame k is full of k
REFERENCE = np.zeros((4, 6, 3), np.uint8)


def test_copy_first_is_the_reference() -> None:
    assert copy_first(REFERENCE, TRUTH).shape == TRUTH.shape and not copy_first(REFERENCE, TRUTH).any()


@pytest.mark.parametrize(
    ("chunk", "frames"), [(3, [0, 0, 0, 3, 3, 3, 6]), (1, [0, 1, 2, 3, 4, 5, 6]), (7, [0] * 7), (50, [0] * 7)]
)
def test_copy_last_is_the_last_frame_of_the_chunk_before(chunk: int, frames: list[int]) -> None:
    assert copy_last(REFERENCE, TRUTH, chunk)[:, 0, 0, 0].tolist() == frames
    assert TRUTH[:, 0, 0, 0].tolist() == [1, 2, 3, 4, 5, 6, 7]  # the truth itself is left alone


def test_raw_simulation_takes_the_size_of_the_truth() -> None:
    assert raw_simulation(TRUTH, TRUTH) is TRUTH
    large = TRUTH.repeat(2, axis=1).repeat(2, axis=2)
    assert np.array_equal(raw_simulation(large, TRUTH), TRUTH)
    assert np.array_equal(raw_simulation(TRUTH, large), large)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(VisionError, match="simulated frames are 6 x 6x4, the true ones 7 x 6x4"):
        raw_simulation(TRUTH[1:], TRUTH)
    with pytest.raises(VisionError, match="chunk is 0"):
        copy_last(REFERENCE, TRUTH, 0)
    with pytest.raises(VisionError, match="reference is 5x4"):
        copy_first(REFERENCE[:, 1:], TRUTH)
