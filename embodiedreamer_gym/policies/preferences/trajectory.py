"""Observations and actions of a policy in one episode, chunk by chunk, and the outcome of the episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import PolicyError

METRICS = ("distance", "object_distance", "remaining")
OUTCOMES = (*METRICS, "is_success", "task_success", "grasp_success")
DEEPER = "/"  # separator of the names of nested observations

Metric = str | Callable[["Trajectory"], float]


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """One episode, of C chunks with k actions each.

    observations: name -> array (C, ...), what the policy saw before each chunk; nested names are joined with a slash,
    such as pixels/head (C, H, W, 3) uint8; actions (C, k, m): executed, in the environment's units, before they are
    clipped to its action space; means (C, k, m): what the policy predicted before exploration noise; counts (C,): how
    many actions of each chunk were played; seed: of the start; attempt: number of the try from this start; outcome:
    numbers at the end, such as distance (m) and is_success.
    Raises: PolicyError if shapes do not fit each other.
    """

    observations: Mapping[str, np.ndarray]
    actions: np.ndarray
    means: np.ndarray
    counts: np.ndarray
    seed: int
    attempt: int = 0
    outcome: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        chunks = len(self.actions)
        fits = self.actions.ndim == 3 and self.means.shape == self.actions.shape and self.counts.shape == (chunks,)
        if not fits or not chunks:
            raise PolicyError(
                f"a trajectory needs actions and means of one shape (chunks, k, m) and counts (chunks,), not "
                f"{self.actions.shape}, {self.means.shape} and {self.counts.shape}."
            )
        for name, values in self.observations.items():
            if len(values) != chunks:
                raise PolicyError(f"{name} has {len(values)} observations for {chunks} chunks; give one each.")
        if not np.isfinite(self.actions).all() or not np.isfinite(self.means).all():
            raise PolicyError("a trajectory holds an action that is not finite.")

    def __len__(self) -> int:
        return len(self.actions)

    def __repr__(self) -> str:
        return f"Trajectory(seed {self.seed}, attempt {self.attempt}, {len(self)} chunks of {self.actions.shape[1:]})"

    @property
    def played(self) -> np.ndarray:
        """Which actions (C, k) were played."""
        return np.arange(self.actions.shape[1]) < self.counts[:, None]

    @property
    def success(self) -> bool:
        """Whether the task was done at the end."""
        return bool(self.outcome.get("is_success", 0.0))

    def score(self, metric: Metric = METRICS[0]) -> float:
        """Score of the episode, less is better: an entry of `outcome`, or the value of a callable for the trajectory.

        Raises: PolicyError for an entry that is missing, or a value that is not finite.
        """
        if isinstance(metric, str) and metric not in self.outcome:
            known = ", ".join(self.outcome) or "nothing"
            raise PolicyError(
                f"metric '{metric}' is not in this trajectory's outcome ({known}); name one, or give a function."
            )
        value = float(self.outcome[metric] if isinstance(metric, str) else metric(self))
        if not np.isfinite(value):
            raise PolicyError(
                f"the metric of {self!r} is {value}; it must be a finite number, and less must be better."
            )
        return value


def flat(observation: Mapping[str, Any], prefix: str = "") -> dict[str, np.ndarray]:
    """Nested observations as one dictionary: {"pixels": {"head": x}} -> {"pixels/head": x}."""
    arrays: dict[str, np.ndarray] = {}
    for name, value in observation.items():
        path = f"{prefix}{name}"
        arrays |= flat(value, path + DEEPER) if isinstance(value, Mapping) else {path: np.asarray(value)}
    return arrays


def nested(observation: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of `flat`."""
    tree: dict[str, Any] = {}
    for name, value in observation.items():
        *way, last = name.split(DEEPER)
        branch = tree
        for part in way:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return tree


def alike(trajectories: Sequence[Trajectory]) -> None:
    """Check that trajectories come from one policy in one environment.

    Raises: PolicyError for an empty sequence, or if chunks, actions or observations differ.
    """
    if not trajectories:
        raise PolicyError("there are no trajectories; roll a policy out first.")
    kinds = {_kind(one) for one in trajectories}
    if len(kinds) > 1:
        shapes = " and ".join(sorted(str(kind) for kind in kinds)[:2])
        raise PolicyError(f"trajectories have different actions or observations, {shapes}; keep them apart.")


def _kind(one: Trajectory) -> tuple[Any, ...]:
    return (one.actions.shape[1:], *((n, v.shape[1:], str(v.dtype)) for n, v in sorted(one.observations.items())))
