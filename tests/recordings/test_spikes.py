"""Spikes of positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.recordings.preflight import preflight
from embodiedreamer_gym.recordings.spikes import without_spikes
from tests.two_joint_arm import load_arm, record


@pytest.fixture
def log(tmp_path: Path) -> Recording:
    made = record(load_arm(tmp_path), noise=3e-4)
    return Recording("log", made.joints, made.time, made.position, made.command)


def spoiled(log: Recording, *samples: int, to: float) -> Recording:
    position = log.position.copy()
    position[list(samples), 1] = to
    return Recording("log", log.joints, log.time, position, log.command)


@pytest.mark.parametrize("to", [1.5, 1e7])
def test_a_spike_is_left_out_and_does_not_count_as_noise(log: Recording, to: float) -> None:
    checked = preflight(spoiled(log, 100, 101, 300, to=to), {"elbow": (-3.0, 3.0)})
    (finding,) = [one for one in checked.findings if one.code == "spike"]
    assert finding.joints == ("elbow",) and "(sample 100) and at 2 more samples" in finding.message
    assert not [one for one in checked.findings if one.severity == "error"]
    assert checked.excluded == {"shoulder": 0, "elbow": 3}
    assert np.abs(checked.recording.position - log.position).max() < 0.05
    assert checked.recording.noise == pytest.approx(log.noise, rel=0.2)


def test_motion_steps_and_noise_are_not_spikes(log: Recording) -> None:
    assert without_spikes(log) == (log, [])
    stepped = log.position + 0.5 * (np.arange(len(log.time)) > 200)[:, None]  # stays there
    rough = log.position + 0.05 * np.random.default_rng(0).standard_normal(log.position.shape)
    for position in (stepped, rough):
        assert without_spikes(log.with_(position=position))[1] == []


def test_many_outliers_are_not_repaired(log: Recording) -> None:
    assert without_spikes(spoiled(log, *range(50, 400, 20), to=2.0))[1] == []
