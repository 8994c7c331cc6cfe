"""A real arm's measured torque without commands; skipped where the data are absent."""

from __future__ import annotations

from pathlib import Path

import pytest

from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel

FRICTION = {"coulomb_friction", "stribeck_friction", "direction_dependent_friction", "load_friction", "hysteresis"}


@pytest.mark.release
def test_the_friction_of_a_franka_is_named(shared_data: Path) -> None:
    """On every joint that least squares finds it on, and the held-out torque is predicted better than by least squares."""
    data = shared_data / "franka_effort"
    if not data.is_dir():
        pytest.skip(f"{data} is not there")
    model = RobotModel.load(data / "model.json")
    train, test = (load_recordings(data / name, joints=model.joints) for name in ("exciteA_1.csv", "exciteB_2.csv"))
    found = diagnose(model, train, test, jobs=1)
    assert found.verdict == "missing"
    assert found.effects[0] in FRICTION
    assert set(found.joints[found.effects[0]]) == set(model.joints)
    assert found.error["least_squares"] == pytest.approx(0.187, abs=0.002)
    assert found.error["with_effect"] <= 0.95 * found.error["least_squares"]
