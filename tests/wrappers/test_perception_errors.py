"""Perception errors: which error an episode gets, when it is added, dropped pictures, and files."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.wrappers import PerceptionErrors, PerceptionErrorWrapper

K, N = 4, 2


class Chunks(gym.Env):
    """Keeps the chunks that it receives; its picture counts them."""

    def __init__(self) -> None:
        self.action_space = spaces.Box(-1.0, 1.0, (K, N), np.float32)
        self.observation_space = spaces.Dict({"pixels": spaces.Box(0, 255, (1, 1, 3), np.uint8)})
        self.played: list[np.ndarray] = []

    def _seen(self) -> dict[str, np.ndarray]:
        return {"pixels": np.full((1, 1, 3), len(self.played), np.uint8)}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.played = []
        return self._seen(), {}

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.played.append(action)
        return self._seen(), 0.0, False, False, {}


def measured(count: int = 5) -> PerceptionErrors:
    """Photo i: actions of i / 10 everywhere, an error of i / 100."""
    sizes = np.arange(count)[:, None, None] * np.ones((1, K, N))
    return PerceptionErrors(sizes / 10, sizes / 100)


def test_an_error_comes_from_the_photos_with_the_most_similar_actions() -> None:
    rng, found = np.random.default_rng(0), set()
    for _ in range(60):
        error = measured().draw(np.full((K, N), 0.31), rng)
        assert error.shape == (K, N) and np.ptp(error) == 0
        found.add(round(100 * float(error[0, 0])))
    assert found == {2, 3, 4}


def test_the_error_is_added_to_the_first_chunk_only() -> None:
    env = Chunks()
    wrapped = PerceptionErrorWrapper(env, measured())
    chunk, firsts = np.full((K, N), 0.4, np.float32), []
    for seed in (0, 1, 2, 3, 0):
        wrapped.reset(seed=seed)
        for _ in range(3):
            wrapped.step(chunk)
        firsts.append(env.played[0])
        assert np.array_equal(env.played[1], chunk) and np.array_equal(env.played[2], chunk)
        assert round(100 * float((env.played[0] - chunk)[0, 0])) in (2, 3, 4)
    assert np.array_equal(firsts[0], firsts[4])  # the same seed
    assert any(not np.array_equal(firsts[0], one) for one in firsts[1:4])


def test_actions_stay_in_their_range_and_shorter_chunks_get_the_beginning_of_an_error() -> None:
    env = Chunks()
    wrapped = PerceptionErrorWrapper(env, measured())
    wrapped.reset(seed=0)
    wrapped.step(np.ones((K, N), np.float32))
    assert env.played[0].max() == 1.0
    rising = np.arange(K * N, dtype=float).reshape(1, K, N)
    assert np.array_equal(PerceptionErrors(rising, rising).draw(rising[0, :2], np.random.default_rng(0)), rising[0, :2])


@pytest.mark.parametrize(("dropped", "shown"), [(0.0, [0, 1, 2, 3]), (1.0, [0, 0, 0, 0])])
def test_a_dropped_picture_is_the_last_one(dropped: float, shown: list[int]) -> None:
    wrapped = PerceptionErrorWrapper(Chunks(), dropped=dropped)
    found = [wrapped.reset(seed=0)[0]] + [wrapped.step(np.zeros((K, N), np.float32))[0] for _ in range(3)]
    assert [int(one["pixels"][0, 0, 0]) for one in found] == shown


def test_some_pictures_are_dropped() -> None:
    wrapped = PerceptionErrorWrapper(Chunks(), dropped=0.3)
    wrapped.reset(seed=0)
    shown = [int(wrapped.step(np.zeros((K, N), np.float32))[0]["pixels"][0, 0, 0]) for _ in range(200)]
    repeated = sum(one == last for last, one in pairwise(shown))
    assert 30 <= repeated <= 90 and shown == sorted(shown)


def test_a_file_gives_the_same_errors(tmp_path: Path) -> None:
    path = tmp_path / "errors.npz"
    measured().save(path)
    again = PerceptionErrors.load(path)
    assert np.allclose(again.actions, measured().actions) and np.allclose(again.errors, measured().errors)
    env = PerceptionErrorWrapper(Chunks(), path)
    env.reset(seed=0)
    env.step(np.zeros((K, N), np.float32))


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04 damaged"])
def test_other_files_are_refused_with_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(SimulationError, match="contains no perception errors of `embodiedreamer policy perception`"):
        PerceptionErrors.load(path)
    with pytest.raises(SimulationError, match="contains no perception errors"):
        PerceptionErrors.load(tmp_path / "missing.npz")
    np.savez(path, actions=np.array([[[np.nan]]]), errors=np.zeros((1, 1, 1)))
    with pytest.raises(SimulationError, match="not finite"):
        PerceptionErrors.load(path)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(SimulationError, match=r"one shape \(N, k, n\)"):
        PerceptionErrors(np.zeros((2, K, N)), np.zeros((3, K, N)))
    with pytest.raises(SimulationError, match=r"measured for chunks \(4, 2\), not \(5, 2\)"):
        measured().draw(np.zeros((K + 1, N)), np.random.default_rng(0))
    wrapped = PerceptionErrorWrapper(Chunks(), measured())
    wrapped.reset(seed=0)
    for wrong in (np.zeros(N), np.full((K, N), np.nan), np.zeros((K, N + 1))):
        with pytest.raises(SimulationError, match="a chunk"):
            wrapped.step(wrong)
    with pytest.raises(SimulationError, match="must be a probability"):
        PerceptionErrorWrapper(Chunks(), measured(), dropped=1.5)
    single = Chunks()
    single.action_space = spaces.Box(-1.0, 1.0, (N,), np.float32)
    with pytest.raises(SimulationError, match="takes chunks"):
        PerceptionErrorWrapper(single, measured())
