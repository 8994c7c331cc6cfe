"""Small sets of episodes whose frames tell their number by their grey."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.recordings.episodes import AlohaWriter

GREY = 6  # from one frame to the next


def picture(number: int, size: tuple[int, int] = (16, 12)) -> np.ndarray:
    """Frame `number`, (H, W, 3); size: width, height."""
    frame = np.full((size[1], size[0], 3), 10 + GREY * number, np.uint8)
    frame[: size[1] // 2, :, 0] += 40  # red above
    return frame


def number_of(frames: np.ndarray) -> list[int]:
    """Which pictures these are."""
    return np.round((frames[..., 1].mean((1, 2)) - 10) / GREY).astype(int).tolist()


@pytest.fixture
def numbers() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """States and actions (T, n) of an episode."""

    def make(length: int, n: int = 14, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(seed)
        return rng.normal(size=(length, n)).astype(np.float32), rng.normal(size=(length, n)).astype(np.float32)

    return make


@pytest.fixture
def shots() -> Callable[..., Iterator[np.ndarray]]:
    """Frames of an episode, one at a time."""
    return lambda length, first=0, size=(16, 12): (picture(first + k, size) for k in range(length))


@pytest.fixture
def seen() -> Callable[[np.ndarray], list[int]]:
    """Which frames of `shots` these are."""
    return number_of


@pytest.fixture
def aloha(tmp_path: Path, numbers, shots) -> Callable[..., Path]:
    """A folder of HDF5 episodes with two cameras; the second one is five frames ahead."""

    def make(lengths: tuple[int, ...] = (9, 12), name: str = "aloha", **options) -> Path:
        with AlohaWriter(tmp_path / name, 30, **options) as writer:
            for seed, length in enumerate(lengths):
                frames = {"head": shots(length), "left_wrist": shots(length, 5)}
                writer.add_episode(*numbers(length, seed=seed), frames, f"task {seed}")
        return tmp_path / name

    return make
