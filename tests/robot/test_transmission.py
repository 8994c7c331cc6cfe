"""Between the motors of a log and the joints of a model: positions, power and files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.transmission import Transmission, direct
from tests.two_joint_arm import load_arm, record, write_arm

MATRIX = [[0.5, 0.0], [-0.5, 0.25]]  # a cable over the elbow couples it to the shoulder's motor
PART = {"motors": ["m1", "m2"], "matrix": MATRIX, "sign": {"m2": -1}, "zero": {"m1": 0.3}}


def motors_of(log: Recording, between: Transmission) -> Recording:
    """The log as the motors show it, by solving for them."""
    linear = between.matrix * between.sign
    solve = lambda x: np.linalg.solve(linear, x.T).T  # noqa: E731
    return log.with_(
        joints=between.motors, position=solve(log.position) + between.zero, command=solve(log.command) + between.zero,
        velocity=solve(log.velocity), effort=log.effort @ linear,
    )  # fmt: skip


def test_motors_become_joints_and_power_is_kept(tmp_path: Path) -> None:
    model = RobotModel.load(write_arm(tmp_path, transmission=PART))
    log = record(load_arm(tmp_path))
    log = log.with_(velocity=np.gradient(log.position, log.time, axis=0))
    motors = motors_of(log, model.transmission)
    (joints,) = model.from_motors([motors.only(["m2", "m1"])])
    assert joints.joints == model.joints
    for name in ("position", "command", "velocity", "effort"):
        assert np.allclose(getattr(joints, name), getattr(log, name), atol=1e-12), name
    power = [(one.effort * one.velocity).sum(axis=1) for one in (motors, joints)]
    assert np.allclose(*power, atol=1e-10) and np.abs(power[0]).max() > 0.1


def test_noise_encoder_steps_and_excluded_samples_follow() -> None:
    between = Transmission(("a", "b"), np.array([[-2.0, 0.0], [1.0, 1.0]]), np.ones(2), np.zeros(2))
    time = np.arange(20) / 50
    usable = np.ones((20, 2), bool)
    usable[3, 0], usable[5, 1] = False, False
    log = Recording("x", ("a", "b"), time, np.zeros((20, 2)), noise=[0.1, 0.2], quantum=[0.01, 0.0], usable=usable)  # pyright: ignore
    one = between.to_joints(log, ("c", "d"))
    assert np.allclose(one.quantum, [0.02, 0.0])
    assert np.allclose(one.noise, [0.2, np.hypot(np.hypot(0.1, 0.2), 0.01 / np.sqrt(12))])
    assert np.argwhere(~one.usable).tolist() == [[3, 0], [3, 1], [5, 1]]


def test_a_model_keeps_its_transmission(tmp_path: Path) -> None:
    model = RobotModel.load(write_arm(tmp_path, transmission=PART))
    model.save(tmp_path / "again.json")
    again = RobotModel.load(tmp_path / "again.json").transmission
    assert again is not None and again.motors == ("m1", "m2") and again.matrix.tolist() == MATRIX
    assert again.sign.tolist() == [1, -1] and again.zero.tolist() == [0.3, 0.0]
    assert "transmission" not in json.loads(write_arm(tmp_path).read_text())
    assert load_arm(tmp_path).from_motors([record(model)])[0].joints == ("shoulder", "elbow")


def test_zeros_and_signs_are_replaced_and_limits_turned() -> None:
    between = direct(["a", "b"]).with_motors({"b": 0.5}, ["a"])
    assert between.sign.tolist() == [-1, 1] and between.zero.tolist() == [0, 0.5]
    assert between.with_motors({"b": 0.1}, []).zero.tolist() == [0, 0.1]
    assert between.motor_limits([(-1, 2), (0, 1)]) == {"a": (-2, 1), "b": (0, 1)}
    with pytest.raises(ModelError, match="'c' is not one of the motors a, b"):
        between.with_motors({"c": 1.0}, [])


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"matrix": [[1, 2], [2, 4]]}, "has no inverse"), ({"matrix": [[1, 0], [0, 0]]}, "has no inverse"),
        ({"matrix": [[1, 0]]}, "2 motors and rows"), ({"matrix": [[1], [0]]}, "list of 2 finite numbers"),
        ({"motors": ["a", "a"]}, "2 different names"), ({"motors": ["a"]}, "2 motors and rows"),
        ({"sign": {"elbow": 2}}, "a sign must be 1 or -1"), ({"zero": {"wrist": 2}}, "names the motor 'wrist'"),
        ({"gear": 3}, "unknown key 'gear' in transmission"), (3, "transmission must be an object"),
    ],
)  # fmt: skip
def test_a_transmission_that_cannot_be(tmp_path: Path, part: object, message: str) -> None:
    with pytest.raises(ModelError, match=message) as caught:
        RobotModel.load(write_arm(tmp_path, transmission=part))
    assert "two.json" in str(caught.value)
