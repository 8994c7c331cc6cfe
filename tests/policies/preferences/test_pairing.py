"""Who is preferred to whom."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import best_of, pair, top_of

STARTS = [7, 7, 7, 3, 3, 3, 5, 5, 5]
SCORES = [0.3, 0.1, 0.2, 0.9, 0.5, 0.7, 0.402, 0.4, 0.401]


def test_best_and_worst_of_each_start_without_ties() -> None:
    assert pair(STARTS, SCORES) == [(1, 0), (4, 3)]
    assert pair(STARTS, SCORES, margin=0.0) == [(1, 0), (4, 3), (7, 6)]
    assert pair(STARTS, SCORES, margin=0.3) == [(4, 3)]


def test_at_most_so_many_pairs_of_one_start_the_widest() -> None:
    assert pair(STARTS, SCORES, top=1) == [(4, 3)]
    assert pair(STARTS, SCORES, top=2, margin=0.0) == [(1, 0), (4, 3)]


def test_a_global_rank_pairs_the_best_with_the_worst_and_scene_with_scene() -> None:
    found = pair(STARTS, SCORES, "global_rank", top=3)
    assert found == [(1, 3), (2, 5), (0, 4)]
    everyone = pair(STARTS, SCORES, "global_rank", margin=0.0)
    assert len(everyone) == 4, "nine trajectories make four pairs, whatever M is"
    assert len({i for p in everyone for i in p}) == 8


def test_a_global_rank_takes_25_unless_told() -> None:
    scores = np.linspace(0, 1, 200)
    assert pair(range(200), scores, "global_rank")[-1] == (24, 175)
    assert len(pair(range(200), scores, "global_rank", top=40)) == 40


@pytest.mark.parametrize("pairing", ["same_start", "global_rank"])
def test_ties_everywhere_are_no_pairs(pairing: str) -> None:
    with pytest.raises(PolicyError, match=r"no pair is left: scores differ by at most 0\.005, and the margin is 0\.01"):
        pair([1, 1, 2, 2], [0.1, 0.105, 0.102, 0.1], pairing)
    with pytest.raises(PolicyError, match="no pair is left"):
        pair([1, 1], [0.1, 0.1], pairing, margin=0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2, 3], [0.1, 0.2, 0.3]), "every start was tried once"),
        (([1, 1], [0.1, 0.2], "best"), "'best' is not one of same_start, global_rank"),
        (([1, 1], [0.1, 0.2], "same_start", 0), "at least 1 pair"),
        (([1, 1], [0.1, 0.2], "same_start", None, -1.0), "margin is -1.0"),
        (([1], [0.1, 0.2]), "1 starts and 2 scores"),
        (([], []), "0 starts and 0 scores"),
    ],
)
def test_bad_input_is_one_sentence(arguments, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        pair(*arguments)


def test_what_is_worth_imitating() -> None:
    assert best_of(STARTS, SCORES) == [1, 4, 7]
    assert top_of(SCORES, 3) == [1, 2, 0]
    assert len(top_of(SCORES)) == 9
