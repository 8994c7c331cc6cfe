"""The bench's robot alone: the same in the logs as in the environment."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.errors import EffectError, ModelError
from embodiedreamer_gym.standin.bench import logs, make_stand_in
from embodiedreamer_gym.standin.bench.robot import build_robot, load_nominal

FAULTS = {"torque_bias": {"torque": [1.0] + [0.0] * 13}, "encoder_offset": {"angle": [0.0, 0.04] + [0.0] * 12}}


def test_logs_are_recordings_of_free_motion_that_a_user_could_calibrate_with() -> None:
    found = logs(FAULTS, count=2, seconds=1.0)
    assert [log.name for log in found] == ["teleoperation_0", "teleoperation_1"]
    commands = [np.asarray(log.command) for log in found]
    for log, command in zip(found, commands, strict=True):
        assert log.joints == load_nominal().joints and log.units == load_nominal().units
        assert (log.kind, log.command_hold, log.hz) == ("episode", "linear", pytest.approx(30.0))
        assert log.position.shape == command.shape == (31, 14)
    assert np.ptp(commands[0] - commands[1]) > 0.05
    again = logs(FAULTS, count=1, seconds=1.0)
    np.testing.assert_array_equal(again[0].position, found[0].position)


def test_logs_and_environment_have_the_very_robot() -> None:
    """Its servos to the last bit; at rest at home, to the sensors' noise, with bias and offset; and along a motion."""
    env, robot = make_stand_in(effects=FAULTS, chunk=20, pictures="none", seed_of_robot=4), build_robot(FAULTS, 4)
    np.testing.assert_array_equal(env.unwrapped.engine.engine._kp, robot.engine._kp)
    np.testing.assert_allclose(
        env.unwrapped.engine.engine.model.body_mass.sum(), 0.33 + robot.engine.model.body_mass.sum(), atol=50
    )
    rest = home(env.unwrapped.robot)
    robot.engine.begin(rest)
    seen, _ = env.reset(seed=0)
    np.testing.assert_allclose(seen["agent_pos"], robot.engine.encoders(), atol=1e-4)
    plain = make_stand_in(pictures="none", seed_of_robot=4).reset(seed=0)[0]["agent_pos"]
    assert abs(seen["agent_pos"][0] - plain[0]) == pytest.approx(1.0 / 80.0, rel=0.1)
    targets = rest + np.linspace(0.0, 0.3, 20)[:, None]
    moved, *_ = env.step(targets)
    knots = np.concatenate([rest[None], targets])
    robot.engine.advance(
        lambda t: np.stack([np.interp(t, np.arange(21) / 30, k) for k in knots.T], 1), round(20 / 30 / 2e-4)
    )
    np.testing.assert_allclose(moved["agent_pos"][:6], robot.engine.encoders()[:6], atol=1e-3)


def test_a_robot_without_a_seed_is_the_nominal_one() -> None:
    model, robot = load_nominal(), build_robot(seed_of_robot=None)
    np.testing.assert_array_equal(robot.true["stiffness"], model.stiffness)
    off = np.abs(build_robot().true["stiffness"] / model.stiffness - 1.0)
    assert 0.01 < off.max() <= 0.05


def test_what_it_cannot_do_is_named() -> None:
    with pytest.raises(ModelError, match="there is no motion 'dance'; give one of multisine"):
        logs(kind="dance")
    with pytest.raises(EffectError, match="the stand-in has no effect 'rust'"):
        logs({"rust": {"depth": 1.0}})
