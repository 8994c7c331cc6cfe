"""What preferences have to beat: supervised fine-tuning continued, filtered cloning, reward-weighted regression."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences.likelihood import ChunkNetwork, Chunks, squared_errors
from embodiedreamer_gym.policies.preferences.pairing import TOP, best_of, top_of
from embodiedreamer_gym.policies.preferences.trajectory import METRICS, Metric, Trajectory

FILTERS = ("best_of", "top")
Progress = Callable[[str, int, int, str], None]  # stage, count, of how many, and what to say of it


@dataclass(frozen=True)
class CloningConfig:
    """How a policy imitates trajectories: epochs over all chunks, chunks of a step, rate of Adam, seed of their order.

    Raises: PolicyError for numbers out of range.
    """

    epochs: int = 80
    batch: int = 256
    rate: float = 1e-4
    seed: int = 0

    def __post_init__(self) -> None:
        if self.epochs < 1 or self.batch < 1 or not self.rate > 0:
            raise PolicyError("cloning needs at least 1 epoch, a batch of at least 1 chunk and a rate above 0.")


def clone(
    network: ChunkNetwork, trajectories: Sequence[Trajectory], config: CloningConfig | None = None,
    weights: Sequence[float] | None = None, progress: Progress | None = None,
) -> tuple[float, ...]:  # fmt: skip
    """Imitate what trajectories did, in place; mean squared error (normalised) of each epoch.

    Demonstrations: supervised fine-tuning continued. weights: of each trajectory, equal where None. Dropout stays off.
    Raises: PolicyError where network and trajectories do not fit, or no weight is above zero.
    """
    config = config or CloningConfig()
    network.eval()
    chunks = Chunks.of(trajectories, network)
    share = torch.as_tensor(np.ones(len(trajectories)) if weights is None else np.asarray(weights, float)).float()
    if share.shape != (len(trajectories),) or not bool((share >= 0).all()) or not bool(share.sum() > 0):
        raise PolicyError(f"cloning needs {len(trajectories)} weights of at least 0, one of them above it.")
    share = (share / share.mean())[chunks.owner]
    size = chunks.played.sum().float() * chunks.actions.shape[2] / len(chunks)  # numbers in a chunk

    def loss(rows: torch.Tensor) -> torch.Tensor:
        return (squared_errors(network, chunks.rows(rows)) * share[rows]).mean() / size

    optimiser = torch.optim.Adam([p for p in network.parameters() if p.requires_grad], config.rate)
    generator, found = torch.Generator().manual_seed(config.seed), []
    for epoch in range(config.epochs):
        total = 0.0
        for rows in torch.randperm(len(chunks), generator=generator).split(config.batch):
            optimiser.zero_grad()
            here = loss(rows)
            here.backward()
            optimiser.step()
            total += float(here.detach()) * len(rows)
        found.append(total / len(chunks))
        if progress is not None:
            progress("cloning", epoch + 1, config.epochs, f"squared error {found[-1]:.4f}")
    return tuple(found)


def filtered(
    rollouts: Sequence[Trajectory], metric: Metric = METRICS[0], by: str = FILTERS[0], top: int = TOP
) -> list[Trajectory]:
    """Rollouts worth imitating: `best_of`, the best try from each start, or `top`, the best M of all.

    Raises: PolicyError for no rollouts, or another filter.
    """
    if by not in FILTERS or not rollouts:
        raise PolicyError(f"filter '{by}' of {len(rollouts)} rollouts: give rollouts, and one of {', '.join(FILTERS)}.")
    scores = [one.score(metric) for one in rollouts]
    chosen = best_of([one.seed for one in rollouts], scores) if by == FILTERS[0] else top_of(scores, top)
    return [rollouts[i] for i in chosen]


def reward_weights(
    rollouts: Sequence[Trajectory], metric: Metric = METRICS[0], temperature: float = 0.05
) -> np.ndarray:
    """Weight (N,) of each rollout, exp(-score / temperature), the best one's being 1.

    temperature: in the metric's unit.
    Raises: PolicyError for a temperature that is not above zero.
    Source: Peters and Schaal, Reinforcement learning by reward-weighted regression, 2007.
    """
    if not temperature > 0:
        raise PolicyError(f"temperature is {temperature}, but must be above 0.")
    scores = np.array([one.score(metric) for one in rollouts])
    return np.exp((scores.min() - scores) / temperature)
