"""Statistics beside the data, against numpy on all of it."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.recordings.episodes.statistics import (
    QUANTILES,
    FrameStatistics,
    combine_statistics,
    number_statistics,
    sampled_frames,
)


def test_numbers() -> None:
    values = np.random.default_rng(0).normal(size=(50, 3))
    found = number_statistics(values)
    assert list(found) == ["min", "max", "mean", "std", *QUANTILES, "count"] and found["count"] == [50]
    assert np.allclose(found["q50"], np.median(values, 0)) and np.allclose(found["std"], values.std(0))


def test_colours_are_counted_exactly() -> None:
    frames = np.random.default_rng(0).integers(0, 255, (6, 20, 30, 3)).astype(np.uint8)
    frames[..., 2] //= 4
    counted = FrameStatistics()
    for frame in frames:
        counted.add(frame)
    found, flat = counted.result(), frames.reshape(-1, 3) / 255
    assert all(value.shape == (3, 1, 1) for name, value in found.items() if name != "count") and found["count"] == [6]
    for name, value in (("min", flat.min(0)), ("max", flat.max(0)), ("mean", flat.mean(0)), ("std", flat.std(0))):
        assert np.allclose(found[name].ravel(), value), name
    for name, share in QUANTILES.items():
        assert np.allclose(found[name].ravel(), np.quantile(flat, share, axis=0), atol=1 / 255), name


def test_large_frames_are_thinned() -> None:
    frame = np.zeros((480, 640, 3), np.uint8)
    frame[1::4] = 255  # rows that thinning by four leaves out
    counted = FrameStatistics()
    counted.add(frame)
    assert counted.result()["max"].max() == 0


@pytest.mark.parametrize(("length", "count"), [(1, 1), (7, 7), (100, 100), (400, 100), (1000, 177), (20000, 1681)])
def test_how_many_frames_are_sampled_frames(length: int, count: int) -> None:
    """The counts that LeRobot's own docstring states."""
    frames = sampled_frames(length)
    assert abs(len(frames) - count) <= 1 and min(frames) == 0 and max(frames) == length - 1


def test_a_set_of_its_parts() -> None:
    values = np.random.default_rng(0).normal(size=(90, 2))
    whole, parts = (
        number_statistics(values),
        combine_statistics([number_statistics(part) for part in np.split(values, [20, 50])]),
    )
    for name in ("min", "max", "mean", "std", "count"):
        assert np.allclose(whole[name], parts[name]), name
    expected = sum(len(p) / 90 * number_statistics(p)["q90"] for p in np.split(values, [20, 50]))
    assert np.allclose(parts["q90"], expected)
