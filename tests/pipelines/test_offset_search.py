"""The search for an offset: which multiple is tried, and that only a significant gain is accepted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from embodiedreamer_gym.pipelines.offset_search import FACTORS, SCREENED, search_offset


class Reach:
    """Scenes that succeed if the action mean is within a tolerance, which differs by scene, of what is wanted."""

    def __init__(self, wanted: float, spread: float = 0.5) -> None:
        self.network: Any = nn.Module()
        self.network.register_buffer("action_mean", torch.zeros(1))
        self.wanted, self.spread, self.played = wanted, spread, []

    def __call__(self, seeds: range) -> list[dict[str, float]]:
        self.played += list(seeds)
        off = abs(float(self.network.action_mean[0]) - self.wanted)
        tolerances = [self.spread * np.random.default_rng(seed).random() for seed in seeds]
        return [{"is_success": float(off < one), "remaining": max(off - one, 0.0)} for one in tolerances]


@pytest.mark.parametrize("factor", FACTORS[:3])
def test_the_best_multiple_is_accepted(factor: float) -> None:
    world = Reach(0.1 * factor)
    found = search_offset(world.network, np.array([0.1]), world, 1000, 200, "remaining")
    assert found["accepted"] and found["factor"] == factor and found["worse"] == 0
    assert np.isclose(float(world.network.action_mean[0]), 0.1 * factor)
    assert found["scenes"] < 200 and found["scenes"] % 10 == 0


def test_the_scenes_of_the_test_are_not_those_of_the_choice() -> None:
    world = Reach(0.2)
    found = search_offset(world.network, np.array([0.1]), world, 1000, 200, "remaining")
    chosen, tested = world.played[: len(FACTORS) * SCREENED], world.played[len(FACTORS) * SCREENED :]
    assert set(chosen) == set(range(1000, 1000 + SCREENED))
    assert sorted(set(tested)) == list(range(1000 + SCREENED, 1000 + SCREENED + found["scenes"]))


def test_an_offset_that_does_not_help_leaves_the_network_as_it_was() -> None:
    for wanted in (0.0, -0.3):
        world = Reach(wanted)
        world.network.action_mean.fill_(0.1 + wanted)  # moves away from what is wanted
        before = world.network.action_mean.clone()
        found = search_offset(world.network, np.array([0.1]), world, 0, 60, "remaining")
        assert not found["accepted"] and torch.equal(world.network.action_mean, before)


def test_chance_is_rarely_accepted() -> None:
    class Coin(Reach):
        def __call__(self, seeds: range) -> list[dict[str, float]]:
            return [{"is_success": float(rng.random() < 0.5), "remaining": 0.0} for _ in seeds]

    rng = np.random.default_rng(1)
    found = []
    for _ in range(200):
        world = Coin(0.0)
        found.append(search_offset(world.network, np.array([0.1]), world, 0, 100, "remaining")["accepted"])
    assert sum(found) <= 10  # at most 5 %, half of them better
