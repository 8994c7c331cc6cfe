"""A linear policy and trajectories of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import nn

from embodiedreamer_gym.policies.preferences import Trajectory

K, M, N = 3, 2, 4  # actions of a chunk, their size, numbers in a state


class Linear(nn.Module):
    """Chunks from states by one layer; an action is normalised as (action - 1) / 2."""

    def __init__(self, dropout: float = 0.0) -> None:
        super().__init__()
        self.layer, self.dropout = nn.Linear(N, K * M), nn.Dropout(dropout)

    def mean(self, batch) -> torch.Tensor:
        return self.layer(self.dropout(batch["agent_pos"])).unflatten(1, (K, M))

    def normalise(self, actions: torch.Tensor) -> torch.Tensor:
        return (actions - 1.0) / 2.0

    def denormalise(self, actions: torch.Tensor) -> torch.Tensor:
        return actions * 2.0 + 1.0


@pytest.fixture
def network() -> Linear:
    torch.manual_seed(0)
    return Linear()


@pytest.fixture
def roll(network: Linear) -> Callable[..., Trajectory]:
    """A trajectory of 5 chunks: what the network says, and noise on it (normalised)."""

    def make(seed: int, attempt: int = 0, distance: float = 0.1, noise: float = 0.1, frames: bool = False, k: int = K):
        rng = np.random.default_rng([seed, attempt])
        seen = {"agent_pos": np.random.default_rng(seed).normal(size=(5, N)).astype(np.float32)}
        with torch.no_grad():
            said = network.denormalise(network.mean({"agent_pos": torch.from_numpy(seen["agent_pos"])})).numpy()[:, :k]
        if frames:
            seen["pixels/head"] = rng.integers(0, 256, (5, 6, 8, 3), np.uint8)
        done = (said + 2.0 * noise * rng.normal(size=said.shape)).astype(np.float32)
        outcome = {"distance": distance, "is_success": float(distance < 0.05)}
        return Trajectory(seen, done, said, np.full(5, k), seed, attempt, outcome)

    return make


@pytest.fixture
def pairs(roll):
    """Eight pairs of one start each, by chance."""
    from embodiedreamer_gym.policies.preferences import PreferenceSet

    rollouts = [roll(seed, attempt, 0.02 + 0.1 * attempt) for seed in range(8) for attempt in range(2)]
    return PreferenceSet.choose(rollouts)
