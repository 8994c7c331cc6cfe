"""Cloning: what it imitates, and how much of it."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import CloningConfig, clone, filtered, reward_weights

QUICK = CloningConfig(epochs=60, batch=8, learning_rate=3e-2)


def error(network, one) -> float:
    """Mean squared error, normalised."""
    with torch.no_grad():
        said = network.mean({"agent_pos": torch.from_numpy(one.observations["agent_pos"])})
        return float(((said - network.normalise(torch.from_numpy(one.actions)))[one.played] ** 2).mean())


def test_it_imitates(network, roll) -> None:
    one = roll(0, noise=1.0)
    before = error(network, one)
    errors = clone(network, [one], QUICK)
    assert len(errors) == 60 and errors[0] == pytest.approx(before, rel=0.3)
    assert error(network, one) < 0.3 * before and errors[-1] < 0.3 * errors[0]


def test_weights_decide_whom(network, roll) -> None:
    one = roll(0, noise=1.0)
    other = replace(one, actions=one.actions + 4.0, attempt=1)
    first, second = copy.deepcopy(network), copy.deepcopy(network)
    clone(first, [one, other], QUICK, [1.0, 0.0])
    clone(second, [one, other], QUICK, [0.0, 3.0])
    assert error(first, one) < error(first, other) and error(second, other) < error(second, one)
    alone = copy.deepcopy(network)
    clone(alone, [one, other], QUICK, [5.0, 0.0])
    assert torch.equal(alone.layer.weight, first.layer.weight), "weights count among themselves"


def test_actions_that_were_not_played_do_not_count(network, roll) -> None:
    one = roll(0, noise=1.0)
    actions = one.actions.copy()
    actions[:, 2] = 1e3
    found = []
    for given in (one.actions, actions):
        fresh = copy.deepcopy(network)
        clone(fresh, [replace(one, actions=given, counts=np.full(5, 2))], QUICK)
        found.append(fresh.layer.weight.detach().clone())
    assert torch.equal(*found)


def test_the_seed_decides_and_progress_is_told(network, roll) -> None:
    found, told = [], []
    for seed in (0, 0, 1):
        fresh = copy.deepcopy(network)
        config = CloningConfig(epochs=2, batch=4, learning_rate=1e-2, seed=seed)
        clone(fresh, [roll(0), roll(1)], config, progress=lambda *said, **more: told.append((*said, *more)))
        found.append(fresh.layer.weight.detach().clone())
    assert torch.equal(found[0], found[1]) and not torch.equal(found[0], found[2])
    assert [said[:3] for said in told[:2]] == [("cloning", 1, 2), ("cloning", 2, 2)]


def test_what_is_left_by_the_filters(roll) -> None:
    rollouts = [roll(s, a, d) for s, a, d in ((0, 0, 0.3), (0, 1, 0.1), (1, 0, 0.9), (1, 1, 0.4), (1, 2, 0.6))]
    assert filtered(rollouts) == [rollouts[1], rollouts[3]]
    assert filtered(rollouts, by="top", top=2) == [rollouts[1], rollouts[0]]
    for by, given in (("best", rollouts), ("best_of", [])):
        with pytest.raises(PolicyError, match="one of best_of, top"):
            filtered(given, by=by)


def test_weights_by_reward(roll) -> None:
    found = reward_weights([roll(0, 0, 0.3), roll(0, 1, 0.1)], temperature=0.2)
    assert found.tolist() == pytest.approx([np.exp(-1.0), 1.0])
    with pytest.raises(PolicyError, match="temperature is 0"):
        reward_weights([roll(0)], temperature=0)


def test_bad_settings_and_weights_are_refused(network, roll) -> None:
    for change in ({"epochs": 0}, {"batch": 0}, {"learning_rate": 0.0}):
        with pytest.raises(PolicyError, match="at least 1 epoch"):
            CloningConfig(**change)
    for weights in ([1.0, 1.0], [-1.0], [0.0]):
        with pytest.raises(PolicyError, match="cloning needs 1 weights"):
            clone(network, [roll(0)], QUICK, weights)
    with pytest.raises(PolicyError, match="no trajectories"):
        clone(network, [], QUICK)
