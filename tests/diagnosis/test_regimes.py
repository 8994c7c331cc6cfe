from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.regimes import REGIMES, gravity_torque, regimes
from embodiedreamer_gym.recordings import Recording, smooth_motion
from tests.two_joint_arm import RATE, load_arm


def log(position: np.ndarray, command: np.ndarray | None = None, noise: float = 1e-4) -> Recording:
    time = np.arange(len(position)) / RATE
    sensor = {"noise": np.full(2, noise), "quantum": np.zeros(2)}
    return Recording("log", ("shoulder", "elbow"), time, position, command, **sensor)


def there_and_back() -> np.ndarray:
    """One second of rest, a second up and a second down at 1 rad/s without a stop, a second of rest."""
    t = np.arange(0, 4, 1 / RATE)
    shoulder = np.interp(t, [0, 1, 2, 3], [0, 0, 1, 0])
    return np.stack([shoulder, np.zeros_like(t)], axis=1)


@pytest.fixture
def arm(tmp_path):
    return load_arm(tmp_path)


def test_a_move_is_cut_into_its_regimes(arm) -> None:
    move = there_and_back()
    masks = {k: v[:, 0] for k, v in regimes(arm, log(move, move)).items()}
    t = np.arange(len(move)) / RATE
    assert tuple(masks) == REGIMES
    assert masks["hold"][t < 0.9].all() and masks["hold"][t > 3.1].all()
    assert masks["fast"][(t > 1.1) & (t < 1.9)].all() and masks["fast"][(t > 2.1) & (t < 2.9)].all()
    assert masks["reversal"][np.abs(t - 2) < 0.03].all()
    assert not masks["reversal"][np.abs(t - 2) > 0.15].any()
    assert masks["accelerating"][np.abs(t - 2) < 0.02].all()
    assert not masks["accelerating"][np.abs(t - 1.5) < 0.3].any()


def test_every_sample_holds_or_is_slow_or_fast(arm) -> None:
    rng = np.random.default_rng(0)
    move = np.cumsum(np.cumsum(rng.normal(0, 1e-4, (400, 2)), axis=0), axis=0)
    masks = regimes(arm, log(move, move))
    assert np.all(masks["hold"].astype(int) + masks["slow"] + masks["fast"] == 1)


def test_a_joint_that_never_moves_only_holds(arm) -> None:
    rng = np.random.default_rng(1)
    move = there_and_back()
    noisy = log(move + 1e-3 * rng.standard_normal(move.shape), move, noise=1e-3)
    masks = regimes(arm, noisy)
    assert masks["hold"][:, 1].mean() > 0.99
    assert not masks["reversal"][:, 1].any() or masks["reversal"][:, 1].mean() < 0.05


def test_a_stuck_joint_that_is_told_to_move_does_not_hold(arm) -> None:
    move = there_and_back()
    stuck = move.copy()
    stuck[:, 0] = 0.0
    masks = regimes(arm, log(stuck, move))
    t = np.arange(len(move)) / RATE
    assert masks["slow"][(t > 1.1) & (t < 1.9), 0].all()


def test_loaded_is_where_gravity_pulls_most(arm) -> None:
    t = np.arange(0, 4, 1 / RATE)
    down = np.stack([np.interp(t, [0, 4], [0.0, np.pi / 2]), np.zeros_like(t)], axis=1)
    loaded = regimes(arm, log(down, down))["loaded"][:, 0]
    torque = np.abs(gravity_torque(arm, down)[:, 0])
    assert loaded[torque > 0.75 * torque.max()].all() and not loaded[torque < 0.65 * torque.max()].any()


def test_smoothing_keeps_a_sine_and_its_derivatives() -> None:
    t = np.arange(0, 3, 1 / RATE)
    wave = np.stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t)], axis=1)
    motion = smooth_motion(log(wave))
    inside = slice(20, -20)
    assert np.abs(motion.position - wave)[inside].max() < 2e-3
    assert np.abs(motion.velocity[:, 0] - 2 * np.pi * np.cos(2 * np.pi * t))[inside].max() < 0.02 * 2 * np.pi
    assert np.abs(motion.acceleration + (2 * np.pi) ** 2 * wave)[inside].max() < 0.03 * (2 * np.pi) ** 2


def test_the_noise_left_in_the_speed_is_as_said() -> None:
    rng = np.random.default_rng(2)
    recording = log(1e-3 * rng.standard_normal((4000, 2)), noise=1e-3)
    motion = smooth_motion(recording)
    assert motion.velocity[50:-50].std(axis=0) == pytest.approx(motion.speed_noise, rel=0.1)
    assert motion.acceleration[50:-50].std(axis=0) == pytest.approx(motion.acceleration_noise, rel=0.1)


def test_a_recording_of_few_samples_is_no_trouble(arm) -> None:
    masks = regimes(arm, log(np.zeros((10, 2)), np.zeros((10, 2))))
    assert masks["hold"].all()
