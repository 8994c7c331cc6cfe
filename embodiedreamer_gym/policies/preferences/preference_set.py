"""Pairs of a preferred and a rejected trajectory: chosen from rollouts, saved and loaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences.files import load_trajectories, save_trajectories
from embodiedreamer_gym.policies.preferences.pairing import MARGIN, PAIRINGS, pair
from embodiedreamer_gym.policies.preferences.trajectory import METRICS, Metric, Trajectory, alike


@dataclass(frozen=True, eq=False, repr=False)
class PreferenceSet:
    """Pairs to learn from: winners[i] is preferred to losers[i]; gaps (n,): by how much, in the metric's unit.

    Raises: PolicyError for an empty or one-sided set, or trajectories of different kinds.
    """

    winners: tuple[Trajectory, ...]
    losers: tuple[Trajectory, ...]
    gaps: tuple[float, ...]
    metric: str
    pairing: str

    def __post_init__(self) -> None:
        sizes = len(self.winners), len(self.losers), len(self.gaps)
        if len(set(sizes)) > 1 or not self.winners:
            raise PolicyError(
                f"a preference set needs as many losers as winners, at least one pair, not {sizes[0]} and {sizes[1]}; "
                "roll out more tries."
            )
        alike((*self.winners, *self.losers))

    @staticmethod
    def choose(
        rollouts: Sequence[Trajectory], metric: Metric = METRICS[0], pairing: str = PAIRINGS[0],
        top: int | None = None, margin: float = MARGIN,
    ) -> PreferenceSet:  # fmt: skip
        """Choose pairs of rollouts by their outcome; see `pair` for pairing, top and margin.

        metric: distance (end effector to target, the paper's), object_distance, remaining, or a function of a
        trajectory; less is better.
        Raises: PolicyError if no pair is left.
        """
        scores = [one.score(metric) for one in rollouts]
        pairs = pair([one.seed for one in rollouts], scores, pairing, top, margin)
        name = metric if isinstance(metric, str) else getattr(metric, "__name__", "a function")
        return PreferenceSet(
            tuple(rollouts[w] for w, _ in pairs), tuple(rollouts[l] for _, l in pairs),
            tuple(float(scores[l] - scores[w]) for w, l in pairs), name, pairing,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.winners)

    def __repr__(self) -> str:
        gap = np.median(self.gaps)
        return f"PreferenceSet({len(self)} pairs by {self.metric}, {self.pairing}, median gap {gap:.3g})"

    @property
    def contrast(self) -> float:
        """Share of pairs whose winner succeeded and whose loser did not."""
        return float(np.mean([w.success and not l.success for w, l in zip(self.winners, self.losers, strict=True)]))

    def save(self, path: str | Path) -> Path:
        """Write an HDF5 file atomically: a temporary file first, which is then renamed.

        Raises: PolicyError if it cannot be written.
        """
        about = {"metric": self.metric, "pairing": self.pairing, "gaps": list(self.gaps)}
        return save_trajectories((*self.winners, *self.losers), path, about)

    @staticmethod
    def load(path: str | Path) -> PreferenceSet:
        """Read what `save` wrote, bit for bit.

        Raises: PolicyError for a missing, damaged or other file.
        """
        trajectories, about = load_trajectories(path)
        if set(about) != {"metric", "pairing", "gaps"}:
            raise PolicyError(f"{path} holds rollouts, but no preference set; choose pairs of them first.")
        try:
            gaps = tuple(float(gap) for gap in about["gaps"])
            halves = tuple(trajectories[: len(gaps)]), tuple(trajectories[len(gaps) :])
            return PreferenceSet(*halves, gaps, str(about["metric"]), str(about["pairing"]))
        except PolicyError as error:
            raise PolicyError(f"{path}: {error}") from error
        except (TypeError, ValueError, OverflowError) as error:
            raise PolicyError(f"{path} holds no preference set: its gaps are not a list of numbers.") from error
