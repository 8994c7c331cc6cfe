"""Logs sampled much faster than efforts are compared: means of consecutive samples."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.recordings.segments import averaged


def log(hz: float, command: bool = False, seconds: float = 2.0) -> Recording:
    """A joint on a sine, with noise."""
    time = np.arange(round(seconds * hz)) / hz
    position = np.sin(2 * time)[:, None] + np.random.default_rng(0).normal(0, 1e-3, (len(time), 1))
    return Recording("log", ("j",), time, position, position if command else None, effort=2 * position, noise=[1e-3])  # fmt: skip


def test_means_keep_the_motion_and_divide_the_noise():
    fast = log(500.0)
    slow = averaged(fast, 100.0)
    assert slow.hz == pytest.approx(100.0) and len(slow.time) == len(fast.time) // 5
    np.testing.assert_allclose(slow.position[:, 0], np.sin(2 * slow.time), atol=2.5e-3)
    np.testing.assert_allclose(slow.effort, 2 * slow.position)
    assert slow.noise == pytest.approx(1e-3 / np.sqrt(5))


def test_a_mean_is_usable_where_all_of_its_samples_are():
    usable = np.ones((1000, 1), bool)
    usable[12] = False
    assert np.flatnonzero(~averaged(log(500.0).with_(usable=usable), 100.0).usable).tolist() == [2]


@pytest.mark.parametrize(("hz", "expected"), [(100.0, 100.0), (149.0, 149.0), (151.0, 75.5), (1000.0, 100.0)])
def test_only_logs_without_commands_and_far_above_100_hz_are_averaged(hz: float, expected: float):
    assert thin([log(hz)], 80.0)[0].hz == pytest.approx(expected, rel=1e-3)
    assert thin([log(hz, command=True)], 80.0)[0].hz == pytest.approx(hz, rel=1e-3)
