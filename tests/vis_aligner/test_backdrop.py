"""A bench without robot and objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.backdrop import PICTURES, make_backdrop, with_backdrops
from embodiedreamer_gym.vis_aligner.clip import ROBOT, Condition, Episode
from tests.vis_aligner.scenes import episode, texture


def test_a_backdrop_is_the_bench() -> None:
    """To within a fraction of the sensor's noise, also where an arm stands in most pictures, and nowhere a thing."""
    episodes = [episode(seed) for seed in range(10)]
    found = make_backdrop(episodes)
    error = np.abs(found.picture.astype(float) - texture(0)).max(axis=2)[found.seen]
    assert np.median(error) <= 1 and np.percentile(error, 90) < 4  # the rest: shadows that never leave
    often = np.mean([(e.condition.classes >= ROBOT).mean(axis=0) for e in episodes], axis=0) > 0.3
    assert (often & found.seen).sum() > 20
    never = np.all([(e.condition.classes >= ROBOT).all(axis=0) for e in episodes], axis=0)
    assert not (found.seen & never).any() and not found.picture[~found.seen].any()


def test_what_was_seen_once_counts() -> None:
    """Also in a picture that is not among those of the median."""
    frames = np.full((2 * PICTURES + 1, 8, 8, 3), 50, np.uint8)
    classes = np.full(frames.shape[:3], ROBOT, np.uint8)
    classes[1], frames[1] = 0, 123  # an odd number: left out of PICTURES evenly drawn ones
    found = make_backdrop([Episode("once", frames, Condition(frames, classes))])
    assert found.seen.all() and (found.picture == 123).all()


def test_each_bench_has_its_own() -> None:
    ones = [replace(episode(seed), bench=bench) for seed, bench in ((0, "a"), (1, "b"), (2, "a"))]
    dark = replace(ones[1], frames=ones[1].frames // 2)
    a, b, again = with_backdrops([ones[0], dark, ones[2]])
    assert a.backdrop is again.backdrop and a.backdrop is not None and b.backdrop is not None
    assert b.backdrop.picture[b.backdrop.seen].mean() < 0.6 * a.backdrop.picture[a.backdrop.seen].mean()


def test_nothing_gives_no_backdrop() -> None:
    with pytest.raises(VisionError, match="at least one episode"):
        make_backdrop([])
