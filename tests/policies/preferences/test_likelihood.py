"""Likelihoods against the paper's sum, written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import Chunks, log_likelihood
from embodiedreamer_gym.policies.preferences.likelihood import likelihood_of_all, spread_of


def by_hand(one, sigma: float = 1.0) -> float:
    """-1 / (2 sigma^2) sum_t |a^_t - a_t|^2 in the network's units, 2 of the environment's."""
    total = 0.0
    for chunk, count in enumerate(one.counts):
        for step in range(count):
            total += float((((one.means[chunk, step] - one.actions[chunk, step]) / 2.0) ** 2).sum())
    return -total / (2 * sigma**2)


def test_the_papers_sum(network, roll) -> None:
    two = [roll(0), replace(roll(1, 1, noise=0.5), counts=np.array([3, 2, 0, 3, 1]))]
    found = log_likelihood(network, Chunks.of(two, network))
    assert found.tolist() == pytest.approx([by_hand(one) for one in two], rel=1e-4)
    wide = log_likelihood(network, Chunks.of(two, network), sigma=0.1)
    assert wide.tolist() == pytest.approx((100 * found).tolist(), rel=1e-5)


def test_a_policys_own_rollout_without_noise_has_the_highest_likelihood(network, roll) -> None:
    assert log_likelihood(network, Chunks.of([roll(0, noise=0.0)], network)).item() == pytest.approx(0.0, abs=1e-9)


def test_of_a_longer_chunk_the_beginning_counts(network, roll) -> None:
    short = roll(0, k=2)
    assert log_likelihood(network, Chunks.of([short], network)).item() == pytest.approx(by_hand(short), rel=1e-4)


def test_a_few_chunks_at_a_time_and_some_trajectories(network, roll) -> None:
    chunks = Chunks.of([roll(s, noise=0.1 * (s + 1)) for s in range(4)], network)
    all_at_once = log_likelihood(network, chunks)
    assert likelihood_of_all(network, chunks, 1.0, 3).tolist() == pytest.approx(all_at_once.tolist(), rel=1e-5)
    some = chunks.part(torch.tensor([3, 1]))
    assert len(some) == 10 and some.count == 2
    assert log_likelihood(network, some).tolist() == pytest.approx(all_at_once[[3, 1]].tolist(), rel=1e-6)


def test_frames_stay_bytes(network, roll) -> None:
    chunks = Chunks.of([roll(0, frames=True)], network)
    assert chunks.observations["pixels/head"].dtype == torch.uint8


def test_a_network_precomputes_once(network, roll) -> None:
    """Object poses are computed once for each frame, and the likelihood is the same."""
    asked = []

    class Digesting(type(network)):
        def precompute(self, batch):
            asked.append(len(batch["agent_pos"]))
            return {"short": batch["agent_pos"][:, :1] * 2.0, "agent_pos": batch["agent_pos"]}

    before = log_likelihood(network, Chunks.of([roll(0), roll(1)], network))
    network.__class__ = Digesting
    chunks = Chunks.of([roll(0), roll(1)], network)
    assert asked == [5, 5] and chunks.observations["short"].shape == (10, 1)
    for _ in range(3):
        torch.testing.assert_close(log_likelihood(network, chunks), before)
    assert asked == [5, 5]


def test_another_policys_trajectories_are_refused(network, roll) -> None:
    other = roll(0)
    other = replace(other, actions=other.actions[..., :1], means=other.means[..., :1])
    with pytest.raises(PolicyError, match="chunks of 3 actions of size 2, but the trajectories contain 3 of size 1"):
        Chunks.of([other], network)
    longer = roll(0)
    longer = replace(longer, actions=np.tile(longer.actions, (1, 2, 1)), means=np.tile(longer.means, (1, 2, 1)))
    with pytest.raises(PolicyError, match="the trajectories contain 6 of size 2"):
        Chunks.of([longer], network)


def test_a_normalised_unit(network) -> None:
    assert spread_of(network, 2).tolist() == [2.0, 2.0]
