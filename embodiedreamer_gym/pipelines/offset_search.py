"""Search for a constant offset of a policy's actions, accepted only if a sequential test shows that it helps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from embodiedreamer_gym.pipelines.policy_comparison import BLOCK, decides
from embodiedreamer_gym.policies.preferences.offset import shift_actions

FACTORS = (1.0, 2.0, 4.0, 8.0)  # of the estimated offset
SCREENED = 20  # scenes on which the factors are compared

Play = Callable[[range], Sequence[dict[str, float]]]  # outcomes of the policy on the scenes of seeds


def search_offset(network: Any, offset: np.ndarray, play: Play, first: int, most: int, metric: str) -> dict[str, Any]:
    """Add the best multiple of an offset (m,) to a network's actions, or leave the network as it was.

    The multiples are compared on `SCREENED` fresh scenes, by success, then by the metric. The best one is then compared
    with no offset on other fresh scenes, in blocks; it is accepted as soon as it is significantly better (5 % level).

    play: plays the network; first: seed of the first scene; most: scenes of the comparison.
    Returns factor, scenes, better and worse (scenes on which only one succeeded) and accepted.
    Raises: PolicyError for a network without `action_mean`.
    """
    mean = network.action_mean.clone() if hasattr(network, "action_mean") else None

    def shifted(factor: float, seeds: range) -> Sequence[dict[str, float]]:
        shift_actions(network, factor * offset)
        try:
            return play(seeds)
        finally:
            network.action_mean.copy_(mean)  # exactly as before

    def quality(factor: float) -> tuple[float, float]:
        ends = shifted(factor, range(first, first + SCREENED))
        return -sum(end["is_success"] for end in ends), sum(end[metric] for end in ends)

    factor = min(FACTORS, key=quality)
    better = worse = scenes = 0
    while scenes < most and not decides(better, worse):
        begun = first + SCREENED + scenes
        seeds = range(begun, begun + min(BLOCK, most - scenes))
        pairs = [
            (new["is_success"], old["is_success"]) for new, old in zip(shifted(factor, seeds), play(seeds), strict=True)
        ]
        better += sum(new > old for new, old in pairs)
        worse += sum(new < old for new, old in pairs)
        scenes += len(seeds)
    accepted = better > worse and decides(better, worse)
    if accepted:
        shift_actions(network, factor * offset)
    return {"factor": factor, "scenes": scenes, "better": better, "worse": worse, "accepted": accepted}
