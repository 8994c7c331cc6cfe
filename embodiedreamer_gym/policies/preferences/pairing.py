"""Pairs of a preferred and a rejected trajectory, chosen by their scores; no frames are read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.errors import PolicyError

PAIRINGS = ("same_start", "global_rank")
TOP = 25  # M of the paper
MARGIN = 0.01  # m: two scores that differ by less are a tie

Pairs = list[tuple[int, int]]


def pair(
    starts: Sequence[int], scores: Sequence[float], pairing: str = PAIRINGS[0], top: int | None = None,
    margin: float = MARGIN,
) -> Pairs:  # fmt: skip
    """Winner and loser of each pair, as indices.

    starts (N,): seed of each trajectory's start; scores (N,): less is better; pairing: `same_start`, the best and the
    worst try from each start, so that neither had the easier scene (GRAPE, Zhang et al. 2024), or `global_rank`, the
    best M of all against the worst M in turn (the paper, section 4.3); top: M, the largest number of pairs (default 25
    with `global_rank`; with `same_start` the pairs that differ most, default all); margin: pairs whose scores differ by
    less are left out.
    Raises: PolicyError if no pair is left, or the arguments do not fit each other.
    """
    if pairing not in PAIRINGS:
        raise PolicyError(f"pairing '{pairing}' is not one of {', '.join(PAIRINGS)}.")
    if top is not None and top < 1:
        raise PolicyError(f"top is {top}, but a set needs at least 1 pair.")
    if not np.isfinite(margin) or margin < 0:
        raise PolicyError(f"margin is {margin}, but must be 0 or more.")
    if len(starts) != len(scores) or not len(starts):
        raise PolicyError(
            f"there are {len(starts)} starts and {len(scores)} scores; give one score for each start, and at least 2."
        )
    values = np.asarray(scores, float)
    pairs = _same_start(np.asarray(starts), values, top) if pairing == PAIRINGS[0] else _global(values, top or TOP)
    kept = [(w, l) for w, l in pairs if values[l] - values[w] > 0 and values[l] - values[w] >= margin]
    if not kept:
        widest = max((values[l] - values[w] for w, l in pairs), default=0.0)
        raise PolicyError(
            f"no pair is left: scores differ by at most {widest:.3g}, and the margin is {margin:g}; "
            "give more tries or more exploration noise, or a smaller margin."
        )
    return kept


def best_of(starts: Sequence[int], scores: Sequence[float]) -> list[int]:
    """The best try from each start, as indices in the order of the starts."""
    values, seeds = np.asarray(scores, float), np.asarray(starts)
    best = []
    for seed in dict.fromkeys(seeds.tolist()):
        tries = np.flatnonzero(seeds == seed)
        best.append(int(tries[np.argmin(values[tries])]))
    return best


def top_of(scores: Sequence[float], top: int = TOP) -> list[int]:
    """The best M of all, as indices, the best first."""
    return [int(i) for i in np.argsort(np.asarray(scores, float), kind="stable")[:top]]


def _same_start(starts: np.ndarray, scores: np.ndarray, top: int | None) -> Pairs:
    """Best and worst try of each start, in the order of the starts."""
    pairs: Pairs = []
    for seed in dict.fromkeys(starts.tolist()):
        tries = np.flatnonzero(starts == seed)
        if len(tries) > 1:
            pairs.append((int(tries[np.argmin(scores[tries])]), int(tries[np.argmax(scores[tries])])))
    if not pairs:
        raise PolicyError("every start was tried once; pairs of one start need 2 or more tries, or global_rank.")
    if top is not None and len(pairs) > top:
        widest = sorted(pairs, key=lambda p: scores[p[0]] - scores[p[1]])[:top]
        pairs = [p for p in pairs if p in widest]
    return pairs


def _global(scores: np.ndarray, top: int) -> Pairs:
    """The best against the worst, the second best against the second worst, and so on; none is on both sides."""
    order = np.argsort(scores, kind="stable").tolist()
    top = min(top, len(order) // 2)
    return list(zip(order[:top], order[::-1][:top], strict=True))
