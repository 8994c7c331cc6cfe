"""Saturation, the torque-speed line of a motor, and what arrives of its torque."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects.torque_constant import TorqueConstant
from embodiedreamer_gym.effects.torque_fade import TorqueFade
from embodiedreamer_gym.effects.torque_saturation import TorqueSaturation
from embodiedreamer_gym.effects.voltage_limit import VoltageLimit
from embodiedreamer_gym.simulation import simulate
from tests.bank import fast, log, robot

TIME = np.arange(201) / 200
STEP = np.where(TIME < 0.05, -1.0, 1.0)[:, None]


def jump(effect, viscous: float = 0.0, sign: float = 1.0):
    """A step of 2 rad of a pendulum, started where its servo carries the weight."""
    model = robot("pendulum1").with_(viscous_friction=np.array([viscous]))
    low = sign * (STEP[0, 0] - 9.81 * 0.15 * np.sin(1.0) / model.stiffness[0])
    position = np.full((len(TIME), 1), sign * STEP[0, 0])
    command = np.where(TIME < 0.05, low, sign * STEP[-1, 0])[:, None]
    return simulate(model.with_effect(effect), log(model, TIME, command, position)), model


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_saturation_caps_the_torque(sign: float) -> None:
    run, _ = jump(TorqueSaturation(limit={"joint1": 6.0}), sign=sign)
    assert np.abs(run.torque).max() <= 6.0 + 1e-12
    assert np.mean(np.abs(run.torque - sign * 6.0) < 1e-9) > 0.1, "the drive should be at its limit for a while"
    free, _ = jump(TorqueSaturation(), sign=sign)
    assert np.abs(free.torque).max() > 30


def test_torque_lies_on_the_torque_speed_line() -> None:
    run, _ = jump(VoltageLimit(forward={"joint1": 3.0}, stall_torque={"joint1": 4.0}))
    line = 4.0 * (1 - run.velocity / 3.0)
    at_limit = (TIME > 0.08) & (run.position[:, 0] < 0.5)
    np.testing.assert_allclose(run.torque[at_limit], line[at_limit], atol=0.05)
    assert np.all(run.torque < line + 0.05)


@pytest.mark.parametrize(("direction", "other"), [("forward", "backward"), ("backward", "forward")])
def test_the_highest_speed_is_where_line_and_load_meet(direction: str, other: str) -> None:
    """stall (1 - v/top) = viscous v, with a stiff line even where one step is longer than its time constant."""
    sign = 1.0 if direction == "forward" else -1.0
    for stall in (3.0, 15.0):
        limit = VoltageLimit(**{direction: {"joint1": 2.0}, "stall_torque": {"joint1": stall}})
        run, model = jump(limit, viscous=0.5, sign=sign)
        bottom = np.argmin(np.abs(run.position[:, 0]))  # no weight there
        speed = stall / (stall / 2.0 + 0.5)
        assert run.velocity[bottom, 0] * sign == pytest.approx(speed, rel=0.03)
        assert model.n == 1
    untouched, _ = jump(VoltageLimit(**{other: {"joint1": 2.0}}), sign=sign)
    assert np.abs(untouched.velocity).max() > 6.0


def test_a_torque_constant_moves_as_its_gains_and_reports_the_torque_before() -> None:
    model = robot("pendulum1")
    motion = fast(model, 1.5)
    stronger = simulate(model.with_effect(TorqueConstant(gain={"joint1": 4.0})), motion)
    stiffer = simulate(model.with_(stiffness=4 * model.stiffness, damping=4 * model.damping), motion)
    np.testing.assert_allclose(stronger.position, stiffer.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(4 * stronger.torque, stiffer.torque, rtol=0, atol=1e-7)


def test_a_fading_drive_carries_a_weight_with_more_and_more_torque() -> None:
    """At rest loss and weight are in balance: what arrives, (1 - loss(t)) of what the drive gives, is the weight."""
    model = robot("pendulum1")
    time = np.arange(401) / 100
    held = log(model, time, np.full((401, 1), 0.8))
    run = simulate(model.with_effect(TorqueFade(loss={"joint1": 0.5}, time={"joint1": 2.0})), held)
    late = time > 1.0
    share = 1 - 0.5 * (1 - np.exp(-time[late] / 2.0))
    weight = 9.81 * 0.15 * np.sin(run.position[late, 0])
    np.testing.assert_allclose(share * run.torque[late, 0], weight, atol=2e-3)
    assert run.torque[-1, 0] > 1.2 * run.torque[100, 0]
