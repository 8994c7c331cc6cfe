"""Synthetic recordings: a servo that follows its command with a delay, a lag, sag and friction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording

STEP_12_BIT = 2 * np.pi / 4096


def follow(
    time: np.ndarray, command: np.ndarray, delay: float = 0.08, lag: float = 0.05, sag: float = 0.0
) -> np.ndarray:
    """Position (T,) of a first-order servo behind a delay, off by a constant sag."""
    target = np.interp(time - delay, time, command)
    x, out = target[0], np.empty_like(target)
    keep = np.exp(-np.median(np.diff(time)) / lag)
    for k, u in enumerate(target):
        x = u + (x - u) * keep
        out[k] = x
    return out - sag


@pytest.fixture
def make() -> Callable[..., Recording]:
    """Three joints and a gripper that move as they should, 50 Hz, 12 s; any field can be changed."""

    def build(name: str = "sine_01", seed: int = 0, delay: float = 0.08, sag: float = 0.015, **changes) -> Recording:
        rng = np.random.default_rng(seed)
        time = np.arange(600) / 50
        tones = [0.6 * np.sin(2 * np.pi * f * time + p) for f, p in ((0.31, 0.2), (0.47, 1.0), (0.73, 2.0))]
        grip = 0.5 + 0.4 * np.sin(2 * np.pi * 0.2 * time)
        command = np.column_stack([*tones, grip])
        position = np.column_stack(
            [follow(time, u, delay, sag=s) for u, s in zip(command.T, (sag, 0, sag, 0), strict=True)]
        )
        position += 5e-4 * rng.standard_normal(position.shape)
        fields = {
            "joints": ("base", "shoulder", "elbow", "gripper"),
            "units": ("rad", "rad", "rad", "1"),
            "time": time,
            "position": position,
            "command": command,
            "velocity": np.gradient(position, time, axis=0),
            "effort": command - position,
        }
        return Recording(name=name, **(fields | changes))

    return build


def equal(a: Recording, b: Recording) -> None:
    """Assert that two recordings hold the same, to the last bit, frames apart."""
    for name in ("name", "joints", "units", "command_hold", "kind", "effort_unit"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("time", "position", "command", "velocity", "effort", "noise", "quantum", "usable", "gain"):
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        assert x is None or (np.array_equal(x, y) and x.dtype == y.dtype), name


@pytest.fixture
def same() -> Callable[[Recording, Recording], None]:
    return equal


@pytest.fixture
def servo() -> Callable[..., np.ndarray]:
    return follow
