"""Servo side: the logged effort against the torque that a model's servo asks for."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.compare import free_runs
from embodiedreamer_gym.diagnosis.servo_fit import ServoFit, fit_servo
from tests.two_joint_arm import load_arm, record

NOISE, EFFORT_NOISE = 5e-4, 0.05  # rad, N m
GAINS = np.array([120.0, 50.0])  # of the effort, which is twice the torque, per rad


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def logs(truth, scale: float = 1.0, offset: float = 0.0):
    """Two recordings whose effort is twice the torque, noisy, times a scale, plus an offset."""
    recordings = []
    for seed in range(2):
        log = record(truth, f"wave_{seed}", NOISE, seed=seed)
        noise = EFFORT_NOISE * np.random.default_rng(seed).standard_normal(log.position.shape)
        recordings.append(log.with_(effort=scale * (np.asarray(log.effort) + noise) + offset))
    return recordings


def fitted(model, recordings) -> ServoFit:
    found = fit_servo(model, recordings, free_runs(model, recordings))
    assert found is not None
    return found


def chi2(model, recordings) -> np.ndarray:
    """Mean square (n,) of the servo's residuals in their noises."""
    found = fitted(model, recordings)
    return found.mean_square / found.variance


def with_effect(arm, effect: str, **values: list[float]):
    """The arm with an effect of these values on shoulder and elbow."""
    named = {f"{effect}.{key}": dict(zip(arm.joints, pair, strict=True)) for key, pair in values.items()}
    return arm.with_effect(effect).with_values(named)


@pytest.fixture(scope="module")
def rubbing(arm):
    return logs(with_effect(arm, "coulomb_friction", torque=[1.0, 0.3]))


@pytest.fixture(scope="module")
def late(arm):
    return logs(with_effect(arm, "command_delay", seconds=[0.03, 0.03]))


def test_what_lies_behind_the_servo_leaves_its_effort_as_it_is(arm, rubbing) -> None:
    assert np.all(chi2(arm, rubbing) < 1.6)


def test_what_lies_before_the_servo_shows(arm, late) -> None:
    assert np.all(chi2(arm, late) > 4)
    assert chi2(with_effect(arm, "command_delay", seconds=[0.03, 0.03]), late) == pytest.approx([1, 1], abs=0.2)


def test_neither_unit_nor_offset_of_the_effort_matters(arm) -> None:
    recordings = logs(arm, scale=-0.4, offset=3.0)
    assert fitted(arm, recordings).scale == pytest.approx([-0.8, -0.8], rel=0.02)
    assert chi2(arm, recordings) == pytest.approx([1, 1], abs=0.2)


def test_an_effort_that_is_read_before_a_held_command_steps(arm) -> None:
    recordings = []
    for log in logs(arm):
        steps = np.diff(np.asarray(log.command), axis=0, prepend=np.asarray(log.command)[:1])
        recordings.append(log.with_(command_hold="hold", effort=np.asarray(log.effort) - steps * GAINS))
    assert np.all(chi2(arm, recordings) < 2)


def test_recordings_without_effort_are_left_out(arm, late) -> None:
    plain = late[0].with_(effort=None)
    found = fitted(arm, [plain, late[1]])
    assert found.residuals[0] is None and found.residuals[1] is not None
    assert fit_servo(arm, [plain], free_runs(arm, [plain])) is None
