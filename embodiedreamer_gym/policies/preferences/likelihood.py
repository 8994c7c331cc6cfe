"""Likelihood of executed chunks under a policy: a Gaussian around the network's prediction, in normalised units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences.trajectory import Trajectory, alike, flat, nested


class ChunkNetwork(Protocol):
    """A network that can be fine-tuned: a torch module that predicts chunks of normalised actions; `Act` is one.

    A network may have a method `precompute(batch)`: it is called once for each batch, and `mean` then gets its result.
    """

    def mean(self, batch: Mapping[str, Any]) -> torch.Tensor:
        """Chunks (B, k, m), normalised, for observations of B instants in the environment's units."""
        ...

    def normalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Convert actions (..., m) in the environment's units to normalised ones."""
        ...

    def denormalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Convert normalised actions (..., m) to the environment's units."""
        ...

    # methods that every torch module has

    def parameters(self) -> Iterator[nn.Parameter]: ...  # noqa: D102
    def state_dict(self) -> dict[str, Any]: ...  # noqa: D102
    def load_state_dict(self, state_dict: Mapping[str, Any]) -> Any: ...  # noqa: D102
    def eval(self) -> Any: ...  # noqa: D102
    def zero_grad(self) -> None: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Chunks:
    """The R chunks of N trajectories, concatenated for a network.

    observations: name -> (R, ...); actions (R, k, m): normalised; played (R, k); owner (R,): number of the trajectory.
    """

    observations: dict[str, torch.Tensor]
    actions: torch.Tensor
    played: torch.Tensor
    owner: torch.Tensor
    count: int

    @staticmethod
    def of(trajectories: Sequence[Trajectory], network: ChunkNetwork) -> Chunks:
        """Concatenate the chunks of trajectories, with actions normalised by the network.

        Raises: PolicyError for trajectories of different kinds, or with actions of another size than the network's.
        """
        alike(trajectories)
        actions = torch.from_numpy(np.concatenate([t.actions for t in trajectories])).float()
        first = nested({n: torch.from_numpy(v[:1]) for n, v in trajectories[0].observations.items()})
        with torch.no_grad():
            k, m = network.mean(first).shape[1:]
        if m != actions.shape[2] or k < actions.shape[1]:
            raise PolicyError(
                f"the policy predicts chunks of {k} actions of size {m}, but the trajectories contain "
                f"{actions.shape[1]} of size {actions.shape[2]}; use rollouts of this policy."
            )
        return Chunks(
            _observations(trajectories, network),
            network.normalise(actions.to(device_of(network))).cpu(),
            torch.from_numpy(np.concatenate([t.played for t in trajectories])),
            torch.from_numpy(np.repeat(np.arange(len(trajectories)), [len(t) for t in trajectories])),
            len(trajectories),
        )

    def part(self, trajectories: torch.Tensor) -> Chunks:
        """The chunks of some trajectories (n,), which are renumbered by their position in this list."""
        place = torch.full((self.count,), -1, dtype=torch.long)
        place[trajectories] = torch.arange(len(trajectories))
        return self.rows(torch.nonzero(place[self.owner] >= 0)[:, 0], place, len(trajectories))

    def rows(self, rows: torch.Tensor, place: torch.Tensor | None = None, count: int | None = None) -> Chunks:
        """Some chunks (r,) of these; place: new number of each trajectory."""
        owner = self.owner[rows] if place is None else place[self.owner[rows]]
        kept = {n: v[rows] for n, v in self.observations.items()}
        return Chunks(kept, self.actions[rows], self.played[rows], owner, self.count if count is None else count)

    def __len__(self) -> int:
        return len(self.actions)


def _observations(trajectories: Sequence[Trajectory], network: ChunkNetwork) -> dict[str, torch.Tensor]:
    """Observations name -> (R, ...) of all chunks, after the network's `precompute` if it has one."""
    precompute = getattr(network, "precompute", dict)
    rows: list[dict[str, torch.Tensor]] = []
    for one in trajectories:
        seen = nested({name: torch.from_numpy(values) for name, values in one.observations.items()})
        with torch.no_grad():
            rows.append({name: torch.as_tensor(values) for name, values in flat(precompute(seen)).items()})
    return {name: torch.cat([row[name] for row in rows]) for name in rows[0]}


def squared_errors(network: ChunkNetwork, chunks: Chunks) -> torch.Tensor:
    """Squared error (R,) of each chunk, summed over its played actions and their joints.

    If fewer actions were executed than the network predicts, only the beginning of its chunk counts.
    """
    predicted = network.mean(nested(chunks.observations)).to(chunks.actions.device)
    errors = (predicted[:, : chunks.actions.shape[1]] - chunks.actions).square().sum(-1)
    return (errors * chunks.played).sum(-1)


def log_likelihood(network: ChunkNetwork, chunks: Chunks, sigma: float = 1.0) -> torch.Tensor:
    """Log-likelihood (N,) of trajectories up to a constant: -1 / (2 sigma^2) sum_t |a^_t - a_t|^2.

    sigma: standard deviation of the Gaussian, in normalised units.
    Source: EmbodieDreamer, appendix `app:rl`, equations `eqn:log_ratio_rewrite` and `eqn:log_prob_act` (sigma 1).
    """
    errors = squared_errors(network, chunks)
    return torch.zeros(chunks.count).index_add(0, chunks.owner, errors) / (-2.0 * sigma**2)


def chunk_batches(chunks: Chunks, size: int) -> Sequence[torch.Tensor]:
    """Numbers of the chunks, `size` at a time."""
    return torch.arange(len(chunks)).split(size)


def likelihood_of_all(network: ChunkNetwork, chunks: Chunks, sigma: float, size: int = 256) -> torch.Tensor:
    """The same as `log_likelihood`, without gradients and `size` chunks at a time."""
    with torch.no_grad():
        return sum((log_likelihood(network, chunks.rows(rows), sigma) for rows in chunk_batches(chunks, size)),
                   torch.zeros(chunks.count))  # fmt: skip


def spread_of(network: ChunkNetwork, size: int) -> np.ndarray:
    """One normalised unit of each action (m,) in the environment's units."""
    zero = torch.zeros(size, device=device_of(network))
    with torch.no_grad():
        return (network.denormalise(zero + 1.0) - network.denormalise(zero)).cpu().numpy()


def device_of(network: ChunkNetwork) -> torch.device:
    """Device of a network."""
    return next((p.device for p in network.parameters()), torch.device("cpu"))
