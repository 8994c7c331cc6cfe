"""Delay, low-pass, rate limit and dead zone against what they are in continuous time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.effects.command_delay import CommandDelay
from embodiedreamer_gym.effects.command_lowpass import CommandLowpass
from embodiedreamer_gym.effects.command_rate_limit import CommandRateLimit
from embodiedreamer_gym.effects.command_timing import CommandTiming
from embodiedreamer_gym.effects.encoder_offset import EncoderOffset
from embodiedreamer_gym.effects.laws import check_laws
from embodiedreamer_gym.effects.servo_deadzone import ServoDeadzone
from tests.bank import play

DT = 1 / 240
TIME = np.arange(480) * DT


@pytest.mark.parametrize("seconds", [0.0, 0.003, DT, 0.025, 0.1, 0.25])
def test_a_delay_shifts_a_ramp_by_exactly_its_time(seconds: float) -> None:
    """0.025 s is six steps, 0.003 s and 0.1 s fall between two."""
    ramp = 0.7 * TIME
    late = play(CommandDelay, ramp, seconds=seconds)
    settled = seconds + DT < TIME
    np.testing.assert_allclose(late[settled], 0.7 * (TIME[settled] - seconds), rtol=0, atol=1e-12)
    assert np.all(late[seconds > TIME] <= ramp[0] + 1e-12), "before, the first command holds"


def test_a_delay_differs_between_joints_and_parameter_sets() -> None:
    p = SimpleNamespace(seconds=np.array([[0.0, 0.01], [0.02, 0.0301]]))
    memory = CommandDelay.start(np.zeros((2, 2)), p, DT)
    joint = SimpleNamespace(dt=DT)
    for t in TIME:
        out, memory = CommandDelay.law(np.full((2, 2), t), joint, memory, p)
    np.testing.assert_allclose(out, TIME[-1] - p.seconds, rtol=0, atol=1e-12)


@pytest.mark.parametrize("constant", [0.002, 0.03, 0.5])
def test_a_low_pass_answers_a_ramp_as_the_analytic_filter(constant: float) -> None:
    out = play(CommandLowpass, TIME, time_constant=constant)
    exact = TIME - constant * (1 - np.exp(-TIME / constant))
    np.testing.assert_allclose(out, exact, rtol=0, atol=1e-12)


def test_a_low_pass_reaches_63_per_cent_of_a_step_after_its_time_constant() -> None:
    step = np.r_[np.zeros(1), np.ones(479)]  # linear over its first step: a step half a step earlier
    out = play(CommandLowpass, step, time_constant=0.1)
    value = np.interp(0.1 + DT / 2, TIME, out)
    assert value == pytest.approx(1 - np.exp(-1), abs=2e-4)


@pytest.mark.parametrize("rate", [0.4, 3.0])
def test_a_rate_limit_turns_a_step_into_a_ramp_of_its_slope(rate: float) -> None:
    out = play(CommandRateLimit, np.r_[np.zeros(1), np.full(479, 0.5)], rate=rate)
    np.testing.assert_allclose(out, np.minimum(rate * TIME, 0.5), rtol=0, atol=1e-12)
    down = play(CommandRateLimit, -np.r_[np.zeros(1), np.full(479, 0.5)], rate=rate)
    np.testing.assert_allclose(down, -out, rtol=0, atol=0)


def test_a_rate_limit_leaves_slow_motion_alone() -> None:
    slow = 0.2 * np.sin(2 * TIME)
    np.testing.assert_allclose(play(CommandRateLimit, slow, rate=0.41), slow, rtol=0, atol=1e-12)


@pytest.mark.parametrize("jump", [0.0, 0.4, 1.0])
def test_a_dead_zone_shrinks_the_error_by_its_width_less_its_jump(jump: float) -> None:
    error = np.array([-0.05, -0.01, -0.004, 0.0, 0.009, 0.01, 0.03])
    expected = [-0.04 - 0.01 * jump, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02 + 0.01 * jump]
    np.testing.assert_allclose(play(ServoDeadzone, error, width=0.01, jump=jump), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("seconds", [-0.002, 0.0, 0.001])
def test_commands_act_late_or_early_by_their_timing(seconds: float) -> None:
    out = play(CommandTiming, 0.7 * TIME, seconds=seconds)
    np.testing.assert_allclose(out[1:], 0.7 * (TIME[1:] - seconds), rtol=0, atol=1e-12)
    step = play(CommandTiming, (TIME > 1.0).astype(float), seconds=seconds)
    assert step[-1] == 1.0
    assert np.sum(1.0 - step) * DT - np.sum(TIME <= 1.0) * DT == pytest.approx(seconds), "the area that is missing"


def test_the_timing_of_commands_keeps_the_laws_of_effects() -> None:
    check_laws(CommandTiming)


def test_an_encoder_offset_is_added_to_what_is_measured() -> None:
    np.testing.assert_allclose(play(EncoderOffset, np.zeros(3), angle=-0.05), -0.05)
