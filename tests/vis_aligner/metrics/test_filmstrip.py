"""A strip shows the frames asked for, untouched, and nothing else but labels."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import strip


@pytest.mark.parametrize("zoom", [1, 2])
def test_frames_stand_side_by_side(bench, zoom: int) -> None:
    picture = strip({"true": bench.frames, "simulator": bench.simulated}, [0, 9], zoom)
    height, width = (zoom * side + 2 for side in bench.frames.shape[1:3])
    top, left = picture.shape[0] - 2 * height, picture.shape[1] - 2 * width
    assert picture.dtype == np.uint8 and top > 10 and left > 40
    for row, frames in enumerate((bench.frames, bench.simulated)):
        for column, index in enumerate((0, 9)):
            y, x = top + row * height, left + column * width
            shown = picture[y : y + height - 2 : zoom, x : x + width - 2 : zoom]
            assert np.array_equal(shown, frames[index])
            assert (picture[y + height - 2 : y + height, x : x + width] == 255).all()


def test_labels_are_written_and_grey(bench) -> None:
    picture = strip({"a": bench.frames, "a longer name": bench.frames}, 3)
    left = picture.shape[1] - 3 * (bench.frames.shape[2] + 2)
    labels = picture[:, :left]
    assert labels.min() < 90 and (labels == labels[..., :1]).all()
    assert (picture[:14, left:] < 128).any() and left > strip({"a": bench.frames}, 3).shape[1] - (
        picture.shape[1] - left
    )


def test_a_number_of_columns_is_spread_from_first_to_last(bench) -> None:
    spread, chosen = strip({"a": bench.frames}, 3), strip({"a": bench.frames}, [0, 8, 16])
    assert np.array_equal(spread, chosen)
    assert np.array_equal(strip({"a": bench.frames}, 99), strip({"a": bench.frames}, range(17)))


def test_what_does_not_fit_is_refused(bench) -> None:
    with pytest.raises(VisionError, match="a 17 x 96x72, b 16 x 96x72"):
        strip({"a": bench.frames, "b": bench.frames[1:]})
    for columns in (0, [17], [-1]):
        with pytest.raises(VisionError, match=r"one or more of 0 \.\. 16"):
            strip({"a": bench.frames}, columns)
    with pytest.raises(VisionError, match="zoom is 0"):
        strip({"a": bench.frames}, zoom=0)
    with pytest.raises(VisionError, match="at least one; given: none"):
        strip({})
