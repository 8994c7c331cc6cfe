"""A curve by chunk is the mean of its frames."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import drift_curve


def test_the_last_chunk_may_be_shorter() -> None:
    assert drift_curve(np.array([1.0, 3, 5, 7, 10]), 2).tolist() == [2.0, 6.0, 10.0]


def test_frames_without_a_value_do_not_count() -> None:
    values = np.array([1.0, np.nan, np.nan, np.nan, 4.0, 8.0])
    assert drift_curve(values, 2) == pytest.approx([1.0, np.nan, 6.0], nan_ok=True)
    assert drift_curve(values, 2, np.array([1, 5, 1, 1, 3, 1])) == pytest.approx([1.0, np.nan, 5.0], nan_ok=True)


def test_channels_stay_apart() -> None:
    assert drift_curve(np.array([[1.0, 10.0], [3.0, 30.0]]), 2).tolist() == [[2.0, 20.0]]


@pytest.mark.parametrize(("values", "chunk", "weights"), [([1.0], 0, None), ([], 2, None), ([1.0, 2.0], 2, [1.0])])
def test_what_is_no_curve_is_refused(values: list, chunk: int, weights: list | None) -> None:
    with pytest.raises(VisionError, match="at least one frame in a chunk"):
        drift_curve(np.array(values), chunk, None if weights is None else np.array(weights))
