"""Baselines of preference learning: continued supervised fine-tuning, filtered cloning, reward-weighted regression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.learning.epochs import run_epochs
from embodiedreamer_gym.policies.preferences.likelihood import ChunkNetwork, Chunks, squared_errors
from embodiedreamer_gym.policies.preferences.pairing import TOP, best_of, top_of
from embodiedreamer_gym.policies.preferences.trajectory import METRICS, Metric, Trajectory

FILTERS = ("best_of", "top")


@renamed_arguments(rate="learning_rate")
@dataclass(frozen=True)
class CloningConfig:
    """How a policy imitates trajectories.

    Raises: PolicyError for numbers out of range.
    """

    epochs: int = 80
    """Epochs over all chunks."""
    batch: int = 256
    """Chunks per step."""
    learning_rate: float = 1e-4
    """Learning rate of Adam."""
    seed: int = 0
    """Seed of the order of the chunks."""

    def __post_init__(self) -> None:
        if self.epochs < 1 or self.batch < 1 or not self.learning_rate > 0:
            raise PolicyError(
                "cloning needs at least 1 epoch, a batch of at least 1 chunk and a learning rate above 0."
            )


def clone(
    network: ChunkNetwork, trajectories: Sequence[Trajectory], config: CloningConfig | None = None,
    weights: Sequence[float] | None = None, progress: ProgressCallback | None = None,
) -> tuple[float, ...]:  # fmt: skip
    """Train a network in place to imitate trajectories; returns the mean squared error (normalised) of each epoch.

    With demonstrations, this continues supervised fine-tuning. weights: of each trajectory, equal if None. Dropout is
    off.
    Raises: PolicyError if network and trajectories do not fit, or no weight is above zero.
    """
    config = config or CloningConfig()
    network.eval()
    chunks = Chunks.of(trajectories, network)
    share = torch.as_tensor(np.ones(len(trajectories)) if weights is None else np.asarray(weights, float)).float()
    if share.shape != (len(trajectories),) or not bool((share >= 0).all()) or not bool(share.sum() > 0):
        raise PolicyError(f"cloning needs {len(trajectories)} weights of at least 0, at least one of them above 0.")
    share = (share / share.mean())[chunks.owner]
    size = chunks.played.sum().float() * chunks.actions.shape[2] / len(chunks)  # mean number of values in a chunk

    totals = [0.0]

    def backward(rows: torch.Tensor) -> None:
        loss = (squared_errors(network, chunks.rows(rows)) * share[rows]).mean() / size
        loss.backward()
        totals[-1] += float(loss.detach()) * len(rows)

    shown = progress_or_silence(progress)
    epochs = run_epochs(
        network.parameters(), backward, len(chunks), epochs=config.epochs, batch=config.batch,
        learning_rate=config.learning_rate, seed=config.seed,
    )  # fmt: skip
    for epoch in epochs:
        shown("cloning", epoch, config.epochs, squared_error=f"{totals[-1] / len(chunks):.4f}")
        totals.append(0.0)
    return tuple(total / len(chunks) for total in totals[:-1])


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
    """Weight (N,) of each rollout, exp(-score / temperature), scaled so that the best one has 1.

    temperature: in the metric's unit.
    Raises: PolicyError for a temperature that is not above zero.
    Source: Peters and Schaal, Reinforcement learning by reward-weighted regression, 2007.
    """
    if not temperature > 0:
        raise PolicyError(f"temperature is {temperature}, but must be above 0.")
    scores = np.array([one.score(metric) for one in rollouts])
    return np.exp((scores.min() - scores) / temperature)
