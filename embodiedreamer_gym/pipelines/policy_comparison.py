"""Comparison of two policies on the same seeds, which stops when it is clear which one is better."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import betaln
from scipy.stats import binomtest

from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.pipelines.policy_runs import play
from embodiedreamer_gym.pipelines.settings import EvaluationSettings
from embodiedreamer_gym.policies.evaluation import Evaluation

BLOCK = 10  # seeds between two decisions
ALPHA = 0.05  # probability of a wrong decision, however often the evidence is computed


def evidence(better: int, worse: int) -> float:
    """Likelihood ratio of the differing pairs: win rate uniform over 0 .. 1, against one half; 1 / ALPHA decides.

    It may be computed after every block, because its mean for equal policies is 1 at any time.
    Source: Ville, 1939; Robbins, Annals of Mathematical Statistics 41, 1970 (mixture over the share, uniform).
    """
    return float(np.exp(betaln(better + 1, worse + 1) + (better + worse) * np.log(2.0)))


def decides(better: int, worse: int) -> bool:
    """Whether the evidence decides, at the 5 % level."""
    return evidence(better, worse) >= 1.0 / ALPHA


@dataclass(frozen=True)
class Comparison:
    """Episodes of two policies on the same seeds, in the same order, and the number of seeds that was allowed."""

    policy: Evaluation
    against: Evaluation
    allowed: int

    @property
    def pairs(self) -> tuple[int, int]:
        """Number of seeds on which only the policy succeeded, and of those on which only the other one did."""
        both = list(zip(self.policy.episodes, self.against.episodes, strict=True))
        better = sum(a.success and not b.success for a, b in both)
        return better, sum(b.success and not a.success for a, b in both)

    @property
    def decided(self) -> bool:
        """Whether the policies differ, at the 5 % level."""
        return decides(*self.pairs)

    def __str__(self) -> str:
        better, worse = self.pairs
        count, first, second = len(self.policy.episodes), self.policy.successes, self.against.successes
        low, high = binomtest(better, better + worse).proportion_ci() if better + worse else (0.0, 1.0)
        verdict = "better" if better > worse else "worse"
        said = f"the policy is {verdict} (5 % level)" if self.decided else "no difference is shown (5 % level)"
        return (
            f"success on {count} of {self.allowed} seeds: the policy {first}, the other {second}; only one succeeded on "
            f"{better + worse} seeds, the policy on {better} of them (95 % interval of its share {low:.0%} .. {high:.0%})\n{said}"
        )

    def as_dict(self) -> dict[str, Any]:
        """The comparison as a JSON-serialisable dictionary."""
        better, worse = self.pairs
        return {"seeds": len(self.policy.episodes), "allowed": self.allowed, "only_policy": better, "only_against": worse,
                "evidence": evidence(better, worse), "decided": self.decided, "policy": self.policy.as_dict(),
                "against": self.against.as_dict()}  # fmt: skip


def compare_policies(run: EvaluationSettings, against: str, progress: ProgressCallback | None = None) -> Comparison:
    """Play both policies block by block on the seeds of a run, in their order, and stop after a block that decides.

    The blocks are the same for any number of processes, and so is the result.
    Raises: as `policy_runs.play`.
    """
    parts: tuple[list[Evaluation], list[Evaluation]] = ([], [])
    for begun in range(0, run.episodes, BLOCK):
        block = replace(run, seed=run.seed + begun, episodes=min(BLOCK, run.episodes - begun))
        for rows, policy in zip(parts, (run.policy, against), strict=True):
            video = None if run.video is None else run.video / ("policy" if rows is parts[0] else "against")
            rows.append(play(replace(block, policy=policy, video=video), progress))
        if Comparison(_joined(parts[0]), _joined(parts[1]), run.episodes).decided:
            break
    return Comparison(_joined(parts[0]), _joined(parts[1]), run.episodes)


def _joined(parts: list[Evaluation]) -> Evaluation:
    """Join the evaluations of several blocks."""
    return replace(parts[0], episodes=tuple(row for part in parts for row in part.episodes))
