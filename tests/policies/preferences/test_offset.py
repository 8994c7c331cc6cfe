"""The constant offset towards which winners explored."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import PreferenceSet, Trajectory, preferred_offset, shift_actions

K, M = 3, 2


def explored(seed: int, attempt: int, noise: tuple[float, float], wanted: np.ndarray) -> Trajectory:
    """Two chunks with constant noise; the score is the distance of the noise from what is wanted."""
    means = np.random.default_rng(seed).normal(size=(2, K, M))
    actions, score = means + np.array(noise), float(np.linalg.norm(np.array(noise) - wanted))
    actions[1, 2:] += 100.0  # not played
    return Trajectory({}, actions, means, np.array([K, 2]), seed, attempt, {"distance": score, "is_success": 0.0})


def test_one_pair_by_hand() -> None:
    wanted = np.array([1.0, 0.0])
    tries = [explored(0, 0, (0.3, 0.1), wanted), explored(0, 1, (-0.1, 0.3), wanted)]
    pairs = PreferenceSet.choose(tries, margin=0.0)
    assert np.allclose(preferred_offset(pairs), [0.2, -0.1])


def test_it_points_to_what_is_wanted() -> None:
    rng, wanted = np.random.default_rng(0), np.array([0.6, -0.8])
    tries = [explored(seed, k, tuple(0.1 * rng.standard_normal(2)), wanted) for seed in range(200) for k in range(4)]
    offset = preferred_offset(PreferenceSet.choose(tries, margin=0.0))
    assert offset @ wanted / np.linalg.norm(offset) > 0.99
    assert 0.05 < np.linalg.norm(offset) < 0.15  # about one standard deviation of the noise


def test_an_offset_is_added_to_all_actions() -> None:
    network = nn.Module()
    network.register_buffer("action_mean", torch.tensor([1.0, 2.0]))
    shift_actions(network, np.array([0.5, -0.5]))
    assert network.action_mean.tolist() == [1.5, 1.5]
    for other in (nn.Linear(2, 2), network):
        with pytest.raises(PolicyError, match="normalises its actions"):
            shift_actions(other, np.zeros(3))
