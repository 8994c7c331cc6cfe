"""What a trajectory holds, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences.trajectory import alike, flat, nested


def test_what_was_played(roll) -> None:
    one = replace(roll(0), counts=np.array([3, 3, 0, 1, 2]))
    assert one.played.sum(1).tolist() == [3, 3, 0, 1, 2]
    assert one.played[3].tolist() == [True, False, False]
    assert len(one) == 5 and "seed 0, attempt 0, 5 chunks of (3, 2)" in repr(one)


def test_score_and_success(roll) -> None:
    one = roll(0, distance=0.02)
    assert one.score() == one.score("distance") == 0.02 and one.success
    assert one.score(lambda t: float(t.seed) + 7) == 7.0
    assert not replace(one, outcome={}).success
    with pytest.raises(
        PolicyError, match=r"'object_distance' is not in this trajectory's outcome \(distance, is_success\)"
    ):
        one.score("object_distance")
    with pytest.raises(PolicyError, match="must be a finite number"):
        one.score(lambda _: float("nan"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"means": np.zeros((5, 3, 1), np.float32)}, "of one shape"),
        ({"counts": np.zeros(4, int)}, "counts"),
        ({"actions": np.zeros((0, 3, 2)), "means": np.zeros((0, 3, 2)), "counts": np.zeros(0, int)}, "of one shape"),
        ({"observations": {"agent_pos": np.zeros((4, 4))}}, "agent_pos has 4 observations for 5 chunks"),
        ({"actions": np.full((5, 3, 2), np.nan, np.float32)}, "not finite"),
    ],
)
def test_what_does_not_fit_is_refused(roll, change, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        replace(roll(0), **change)


def test_observations_flat_and_nested() -> None:
    deep = {"agent_pos": np.zeros(2), "pixels": {"head": np.ones(3), "wrist": np.ones(4)}}
    assert list(flat(deep)) == ["agent_pos", "pixels/head", "pixels/wrist"]
    again = nested(flat(deep))
    assert list(again["pixels"]) == ["head", "wrist"] and again["pixels"]["wrist"] is deep["pixels"]["wrist"]


def test_other_policies_or_cameras_are_kept_apart(roll) -> None:
    alike([roll(0), roll(1)])
    with pytest.raises(PolicyError, match="there are no trajectories"):
        alike([])
    with pytest.raises(PolicyError, match="different actions or observations"):
        alike([roll(0), roll(1, frames=True)])
    with pytest.raises(PolicyError, match="different actions or observations"):
        alike([roll(0), roll(1, k=2)])
