"""Torques and set points of a servo's firmware against what they are by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.effects import SignalLaw
from embodiedreamer_gym.effects.command_lowpass import CommandLowpass
from embodiedreamer_gym.effects.command_rate_limit import CommandRateLimit
from embodiedreamer_gym.effects.derivative_on_error import DerivativeOnError
from embodiedreamer_gym.effects.friction_compensation import FrictionCompensation
from embodiedreamer_gym.effects.gravity_compensation import GravityCompensation
from embodiedreamer_gym.effects.integral_action import IntegralAction
from embodiedreamer_gym.effects.lookahead import Lookahead
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.effects.profile import Profile
from embodiedreamer_gym.effects.pwm_deadband import PwmDeadband
from embodiedreamer_gym.effects.supply_sag import SupplySag
from embodiedreamer_gym.effects.velocity_cascade import VelocityCascade
from embodiedreamer_gym.effects.voltage_limit import VoltageLimit
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from tests.bank import fast, log, play, robot, still

DT = 1 / 240
TIME = np.arange(480) * DT
WEIGHT = 9.81 * 0.15  # N m at the horizontal


def held(effect, command: float = 0.8, start: float = 0.8, **changes):
    """The end of four seconds under one command."""
    model = robot("pendulum1").with_(**changes)
    time = np.arange(401) / 100
    rows = np.full((401, 1), command)
    run = simulate(model.with_effect(effect), log(model, time, rows, np.full((401, 1), start)))
    return run.position[-1, 0], run.torque[-1, 0]


def test_a_profile_of_a_step_is_a_trapezoid() -> None:
    """1 rad at 4 rad/s^2 and 1 rad/s: 0.25 s to the top speed, 0.75 s at it, 0.25 s to rest."""
    place = play(Profile, np.where(TIME > 0, 1.0, 0.0), acceleration=4.0, speed=1.0)
    assert np.diff(place).max() / DT == pytest.approx(1.0, abs=1e-9)
    assert np.interp(0.25, TIME, place) == pytest.approx(0.125, abs=4e-3)
    assert np.interp(1.0, TIME, place) == pytest.approx(0.875, abs=4e-3)
    assert np.interp(1.3, TIME, place) == pytest.approx(1.0, abs=1e-3) and place.max() <= 1.0 + 1e-6


def test_a_profile_without_acceleration_limit_is_a_rate_limit() -> None:
    wave = np.sin(7 * TIME)
    np.testing.assert_allclose(play(Profile, wave, acceleration=np.inf, speed=2.0),
                               play(CommandRateLimit, wave, rate=2.0), atol=4e-3)  # fmt: skip


def test_a_lookahead_of_high_gain_is_a_lowpass_and_of_any_gain_comes_late_by_its_time() -> None:
    wave = np.sin(7 * TIME)
    stiff = play(Lookahead, wave, seconds=0.1, inverse_gain=1e-6)
    np.testing.assert_allclose(stiff, play(CommandLowpass, wave, time_constant=0.1), atol=1e-5)
    for inverse_gain in (0.1, 0.25, 1.0):
        ramp = play(Lookahead, 0.5 * TIME, seconds=0.1, inverse_gain=inverse_gain)
        assert ramp[-1] == pytest.approx(0.5 * (TIME[-1] - 0.1), abs=1e-4)
    swing = play(Lookahead, np.where(TIME > 0.1, 1.0, 0.0), seconds=0.1, inverse_gain=1.0).max()
    assert swing == pytest.approx(1 + np.exp(-np.pi * 0.5 / np.sqrt(0.75)), abs=5e-3)  # damping ratio 0.5


def test_a_compensated_weight_does_not_sag_but_a_load_does() -> None:
    full = {"joint1": 1.0}
    assert held(GravityCompensation(share=full))[0] == pytest.approx(0.8, abs=1e-6)
    assert held(GravityCompensation(share={"joint1": -1.0}), gravity_compensation=np.ones(1))[0] < 0.79
    position, torque = held(GravityCompensation(), gravity_compensation=np.ones(1))
    assert position == pytest.approx(0.8, abs=1e-6) and torque == pytest.approx(WEIGHT * np.sin(0.8), rel=1e-5)
    model = robot("pendulum1").with_effect(Payload(mass={"tip": 0.2}))
    run = simulate(model.with_effect(GravityCompensation(share=full)), still(model, np.array([0.8])))
    assert np.ptp(run.position) > 0.01, "the command carries the nominal weight a second time"


@pytest.mark.parametrize("kind", [IntegralAction, VelocityCascade])
def test_an_integral_leaves_no_error_and_starts_at_rest(kind: type[SignalLaw]) -> None:
    assert held(kind(rate={"joint1": 4.0}))[0] == pytest.approx(0.8, abs=1e-9), "in balance from the beginning"
    assert held(kind(rate={"joint1": 4.0}), start=0.5)[0] == pytest.approx(0.8, abs=1e-3)


def test_an_integral_starts_with_what_gravity_compensation_and_a_drives_gain_leave() -> None:
    model = robot("arm6").with_effect("integral_action").with_effect("gravity_compensation")
    model = model.with_effect("torque_constant").with_effect("torque_bias")
    each = lambda value: dict.fromkeys(model.joints, value)  # noqa: E731
    model = model.with_values({"integral_action.rate": each(3.0), "gravity_compensation.share": each(0.5),
                               "torque_constant.gain": each(1.5), "torque_bias.torque": each(0.2)})  # fmt: skip
    pose = np.array([0.3, -0.5, 0.9, 0.4, 0.3, 0.2])
    time = np.arange(101) / 100
    rows = np.tile(pose, (101, 1))
    run = simulate(model, log(model, time, rows, rows))
    np.testing.assert_allclose(run.position, rows, atol=1e-7)


def test_an_integral_is_clamped() -> None:
    position, torque = held(IntegralAction(rate={"joint1": 4.0}, limit={"joint1": 0.3}))
    assert torque == pytest.approx(WEIGHT * np.sin(position), abs=1e-4)
    assert robot("pendulum1").stiffness[0] * (0.8 - position) + 0.3 == pytest.approx(torque, abs=1e-4)


def test_a_dead_band_takes_its_level_off_and_starts_with_a_jump() -> None:
    joint = SimpleNamespace(damping=np.full((1, 5), 2.0), velocity=np.full((1, 5), 0.5))
    p = SimpleNamespace(level=np.full((1, 5), 0.8), start=np.full((1, 5), 0.3))
    asked = np.array([[-2.0, -0.7, 0.0, 0.7, 2.0]])
    out, _ = PwmDeadband.law(asked + 1.0, joint, None, p)
    np.testing.assert_allclose(out - 1.0, [[-1.5, 0.0, 0.0, 0.0, 1.5]], atol=1e-12)


@pytest.mark.parametrize("duty", [-0.9, -0.2, 0.4, 1.0])
@pytest.mark.parametrize("speed", [-3.0, 0.0, 5.0])
def test_a_sagging_supply_gives_the_current_of_its_circuit(duty: float, speed: float) -> None:
    """A motor on PWM: its current passes the supply only while the PWM is on."""
    volts, winding, constant, supply = 7.4, 4.0, 0.9, 0.8
    a = np.array([[winding, abs(duty)], [-supply, 1.0]])  # R I + |d| U = d V - k v and U = r I, the voltage lost
    current = np.linalg.solve(a, [duty * volts - constant * speed, 0.0])[0]
    joint = SimpleNamespace(damping=np.full((1, 1), constant**2 / winding), velocity=np.full((1, 1), speed))
    stall = constant * volts / winding
    p = SimpleNamespace(sag=np.full((1, 1), supply / winding / stall))
    asked, _ = SupplySag.law(np.full((1, 1), duty * stall), joint, None, p)
    assert (asked - joint.damping * joint.velocity)[0, 0] == pytest.approx(constant * current, abs=1e-12)


def test_a_joint_yields_more_than_in_proportion_where_the_supply_sags() -> None:
    position, torque = held(SupplySag(sag={"joint1": 0.3}), command=1.4)
    asked = robot("pendulum1").stiffness[0] * (1.4 - position)
    assert torque == pytest.approx(WEIGHT * np.sin(position), abs=1e-4)
    assert torque == pytest.approx(asked / (1 + 0.3 * asked), abs=1e-4)


def test_feed_forward_follows_a_ramp_without_lag() -> None:
    model = robot("pendulum1")
    time = np.arange(301) / 100
    ramp = log(model, time, (-0.3 + 0.2 * time)[:, None])
    share = DerivativeOnError(share={"joint1": 1.0})
    viscous = FrictionCompensation(viscous={"joint1": float(model.damping[0])})
    runs = [simulate(model.with_effect(e), ramp) for e in (share, viscous)]
    np.testing.assert_allclose(runs[0].position, runs[1].position, atol=1e-9)
    dry = simulate(model.with_effect(FrictionCompensation(dry={"joint1": 0.4})), ramp)
    plain = simulate(model, ramp)
    middle = 150  # no weight there
    stiffness = model.stiffness[0]
    assert stiffness * (runs[0].position - plain.position)[middle, 0] == pytest.approx(model.damping[0] * 0.2, rel=0.05)
    assert stiffness * (dry.position - plain.position)[middle, 0] == pytest.approx(0.4, rel=0.05)


def test_other_effects_stay_as_they_are_to_the_bit() -> None:
    """A law of the servo's torque that is off changes nothing, and without one nothing is worked out."""
    model = robot("arm6").with_effect("coulomb_friction")
    a, b = (simulate(m, fast(m, 0.5)) for m in (model, model.with_effect("derivative_on_error")))
    np.testing.assert_array_equal(a.position, b.position)


def test_the_former_name_of_the_voltage_limit_is_taken(tmp_path) -> None:
    model = robot("arm6")
    with pytest.deprecated_call(match="'velocity_limit' is now 'voltage_limit'"):
        named = model.with_effect("velocity_limit")
    assert isinstance(named.effects[0], VoltageLimit)
    named.with_(fixed=frozenset({"voltage_limit"}), intervals={"voltage_limit.forward[joint1]": (1.0, 2.0)}).save(
        tmp_path / "a.json"
    )
    old = tmp_path / "old.json"
    old.write_text((tmp_path / "a.json").read_text().replace("voltage_limit", "velocity_limit"))
    with pytest.deprecated_call():
        back = RobotModel.load(old)
    assert back.effects == named.effects and back.fixed == {"voltage_limit"}
    assert list(back.intervals) == ["voltage_limit.forward[joint1]"]


def test_a_models_gravity_compensation_survives_its_file(tmp_path) -> None:
    model = robot("arm6").with_(gravity_compensation=np.full(6, 0.9))
    model.save(tmp_path / "a.json")
    np.testing.assert_array_equal(RobotModel.load(tmp_path / "a.json").gravity_compensation, 0.9)
