"""Sets of pairs, chosen, written and read: bit by bit, or one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import PreferenceSet, load_trajectories, save_trajectories


def same(one, other) -> bool:
    arrays = all(
        np.array_equal(a, b) and a.dtype == b.dtype
        for a, b in ((getattr(one, n), getattr(other, n)) for n in ("actions", "means", "counts"))
    )
    seen = list(one.observations) == list(other.observations) and all(
        np.array_equal(v, other.observations[n]) and v.dtype == other.observations[n].dtype
        for n, v in one.observations.items()
    )
    return arrays and seen and (one.seed, one.attempt, one.outcome) == (other.seed, other.attempt, other.outcome)


def test_pairs_of_rollouts(roll) -> None:
    rollouts = [roll(s, a, d) for s, a, d in ((0, 0, 0.3), (0, 1, 0.01), (0, 2, 0.2), (1, 0, 0.02), (1, 1, 0.025))]
    found = PreferenceSet.choose(rollouts)
    assert len(found) == 1 and found.winners == (rollouts[1],) and found.losers == (rollouts[0],)
    assert found.gaps == pytest.approx((0.29,)) and found.contrast == 1.0
    assert "1 pairs by distance, same_start, median gap 0.29" in repr(found)
    every = PreferenceSet.choose(rollouts, pairing="global_rank", top=2, margin=0.0)
    assert [(w.seed, l.seed) for w, l in zip(every.winners, every.losers, strict=True)] == [(0, 0), (1, 0)]
    assert PreferenceSet.choose(rollouts, lambda one: -one.score()).winners[0] is rollouts[0]


def test_it_comes_back_as_it_was(roll, tmp_path: Path) -> None:
    rollouts = [roll(s, a, 0.1 + a / 3, frames=True) for s in range(3) for a in range(2)]
    pairs = PreferenceSet.choose([replace(one, counts=np.array([3, 3, 3, 1, 0])) for one in rollouts])
    again = PreferenceSet.load(pairs.save(tmp_path / "pairs.hdf5"))
    assert len(again) == 3
    both = zip((*pairs.winners, *pairs.losers), (*again.winners, *again.losers), strict=True)
    assert all(same(one, other) for one, other in both)
    assert (again.gaps, again.metric, again.pairing) == (pairs.gaps, pairs.metric, pairs.pairing)
    assert [p.name for p in tmp_path.iterdir()] == ["pairs.hdf5"]


def test_rollouts_alone_are_no_set(roll, tmp_path: Path) -> None:
    path = save_trajectories([roll(0), roll(1)], tmp_path / "rollouts.hdf5", {"note": "mine"})
    found, about = load_trajectories(path)
    assert same(found[1], roll(1)) and about == {"note": "mine"}
    with pytest.raises(PolicyError, match="holds rollouts, but no preference set"):
        PreferenceSet.load(path)


def test_an_empty_or_one_sided_set_is_refused(roll) -> None:
    with pytest.raises(PolicyError, match="at least one pair, not 0 and 0"):
        PreferenceSet((), (), (), "distance", "same_start")
    with pytest.raises(PolicyError, match="as many losers as winners, at least one pair, not 1 and 0"):
        PreferenceSet((roll(0),), (), (), "distance", "same_start")


def test_a_damaged_file_is_one_sentence(roll, tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="does not exist"):
        PreferenceSet.load(tmp_path / "none.hdf5")
    (tmp_path / "text.hdf5").write_text("no HDF5")
    with pytest.raises(PolicyError, match="damaged or another kind of file"):
        PreferenceSet.load(tmp_path / "text.hdf5")
    with h5py.File(tmp_path / "other.hdf5", "w") as file:
        file["action"] = np.zeros(3)
    with pytest.raises(PolicyError, match="no trajectories of this version"):
        load_trajectories(tmp_path / "other.hdf5")
    path = save_trajectories([roll(0), roll(1)], tmp_path / "flat.hdf5")
    with h5py.File(path, "a") as file:
        del file["000001"]["observations"]
        file["000001"]["observations"] = np.zeros(3)
    with pytest.raises(PolicyError, match=r"flat\.hdf5: /000001/observations is not a group"):
        load_trajectories(path)
    path = save_trajectories([roll(0)], tmp_path / "gaps.hdf5", {"metric": "distance", "pairing": "p", "gaps": None})
    with pytest.raises(PolicyError, match=r"gaps\.hdf5 holds no preference set: its gaps are not a list of numbers"):
        PreferenceSet.load(path)
    pairs = {"metric": "distance", "pairing": "p", "gaps": [0.1]}
    path = save_trajectories([roll(0), roll(1, k=2)], tmp_path / "two.hdf5", pairs)
    with pytest.raises(PolicyError, match=r"two\.hdf5: trajectories have different actions"):
        PreferenceSet.load(path)
    path = save_trajectories([roll(0), roll(1)], tmp_path / "cut.hdf5")
    with h5py.File(path, "a") as file:
        del file["000001"]["means"]
    with pytest.raises(PolicyError, match="damaged or another kind of file"):
        load_trajectories(path)


def test_a_file_that_claims_more_than_fits_into_memory_is_refused(roll, tmp_path: Path) -> None:
    path = save_trajectories([roll(0)], tmp_path / "huge.hdf5")
    for name in ("means", "observations/agent_pos"):
        with h5py.File(path, "a") as file:
            del file["000000"][name]
            file["000000"].create_dataset(name, (10**9, 14), "f4", chunks=(64, 14))  # a few kB
        with pytest.raises(PolicyError, match="damaged or another kind of file") as caught:
            load_trajectories(path)
        assert f"{name} claims" in str(caught.value.__cause__)


def test_nothing_half_written_is_left(roll, tmp_path: Path) -> None:
    path = save_trajectories([roll(0)], tmp_path / "kept.hdf5")
    before = path.read_bytes()
    broken = replace(roll(1))
    object.__setattr__(broken, "outcome", {"distance": "near"})
    with pytest.raises(ValueError, match="near"):
        save_trajectories([broken], path)
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["kept.hdf5"]
    with pytest.raises(PolicyError, match="cannot be written"):
        save_trajectories([roll(0)], tmp_path / "nowhere" / "x.hdf5")
