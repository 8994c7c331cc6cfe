"""What the stand-in's servos do in firmware, by numbers worked out by hand on a pendulum."""

import numpy as np
import pytest

from embodiedreamer_gym.standin.hidden import Hidden, shape_command

WEIGHT = 1.0 * 9.81 * 0.15  # N m at the horizontal
STIFFNESS, DAMPING = 40.0, 1.5
DT = 1e-4


def shaped(setpoint, seconds, **effect):
    return shape_command(lambda t: setpoint(t)[:, None], Hidden(effect, np.ones(1), 1), round(seconds / DT), DT)[:, 0]


def test_a_profile_of_a_step_is_a_trapezoid():
    """1 rad at 4 rad/s^2 and 1 rad/s: 0.25 s to the top speed, 0.75 s at it, 0.25 s to rest."""
    place = shaped(lambda t: (t > 0) * 1.0, 2.0, profile={"acceleration": 4.0, "speed": 1.0})
    speed = np.diff(place) / DT
    assert speed.max() == pytest.approx(1.0, abs=1e-3)
    assert place[2500] == pytest.approx(0.125, abs=2e-3)
    assert place[10000] == pytest.approx(0.875, abs=2e-3)
    assert place[12600] == pytest.approx(1.0, abs=1e-3) and place.max() < 1.0 + 1e-4


def test_a_lookahead_comes_late_by_its_time_and_swings_with_its_gain():
    ramp = shaped(lambda t: 0.5 * t, 1.0, lookahead={"seconds": 0.1, "inverse_gain": 0.25})
    assert ramp[-1] == pytest.approx(0.5 * (1.0 - 0.1), abs=1e-3)
    step = shaped(lambda t: (t > 0) * 1.0, 1.0, lookahead={"seconds": 0.1, "inverse_gain": 1.0})
    assert step.max() == pytest.approx(1 + np.exp(-np.pi * 0.5 / np.sqrt(0.75)), abs=1e-3)  # damping ratio 0.5


def test_derivative_on_error_takes_the_lag_off_a_ramp(build, moves):
    ramp = moves.ramp(-0.1, 0.2, 1.0)
    for share in (0.0, 1.0):
        log = build(effects={"derivative_on_error": {"share": share}}).record(ramp)
        pull = STIFFNESS * (log.command - log.position)[70, 0]
        resisted = WEIGHT * np.sin(log.position[70, 0]) + 0.2 * log.velocity[70, 0]
        slip = log.velocity[70, 0] - share * 0.2
        assert pull - resisted == pytest.approx(DAMPING * slip, abs=2e-3)


def test_friction_compensation_pushes_along_the_command(build, moves):
    values = {"friction_compensation": {"dry": 0.3, "viscous": 0.5}}
    for sign in (1, -1):
        log = build(effects=values).record(moves.ramp(-0.1 * sign, 0.2 * sign, 1.0))
        carried = WEIGHT * np.sin(log.position[70, 0]) + (DAMPING + 0.2) * log.velocity[70, 0]
        pull = STIFFNESS * (log.command - log.position)[70, 0]
        assert carried - pull == pytest.approx(sign * (0.3 + 0.5 * 0.2), abs=2e-3)


def test_gravity_compensation_knows_the_nominal_weight_only(build, moves):
    share = {"gravity_compensation": {"share": 1.0}}
    log = build(effects=share).record(moves.hold(0.8))
    assert log.position[-1, 0] == pytest.approx(0.8, abs=1e-4)
    loaded = build(effects={**share, "payload": {"mass": 0.5, "z": -0.1}}).record(moves.hold(0.8))
    sag = 0.8 - loaded.position[-1, 0]
    assert STIFFNESS * sag == pytest.approx(0.5 * 9.81 * 0.4 * np.sin(0.8 - sag), rel=1e-2)


@pytest.mark.parametrize("effect", ["integral_action", "velocity_cascade"])
def test_an_integral_leaves_no_error_at_holds(build, moves, effect):
    robot = build(effects={effect: {"rate": 4.0}})
    log = robot.record(moves.step(0.3, 0.5, 3.0))
    assert np.abs(log.command - log.position)[[0, -1], 0].max() < 1e-3
    assert np.abs(log.command - build().record(moves.step(0.3, 0.5, 3.0)).position)[-1, 0] > 0.02


def test_an_integral_is_clamped(build, moves):
    log = build(effects={"integral_action": {"rate": 4.0, "limit": 0.3}}).record(moves.hold(0.8))
    position = log.position[-1, 0]
    assert STIFFNESS * (0.8 - position) + 0.3 == pytest.approx(WEIGHT * np.sin(position), abs=1e-3)


def test_a_cascade_limits_its_speed(build, moves):
    fast = moves.step(-0.5, 1.0, 2.0)
    assert build().record(fast).velocity.max() > 3
    assert 0.7 < build(effects={"velocity_cascade": {"rate": 0.1, "speed": 1.0}}).record(fast).velocity.max() < 1.15


def test_a_dead_band_gives_nothing_then_jumps(build, moves):
    robot = build(effects={"pwm_deadband": {"level": 0.8, "start": 0.2}})
    assert np.ptp(robot.record(moves.step(0.0, 0.019)).position) < 1e-9
    log = robot.record(moves.hold(1.2))
    position, effort = log.position[-1, 0], log.effort[-1, 0]
    assert effort == pytest.approx(WEIGHT * np.sin(position), abs=1e-2)
    assert STIFFNESS * (1.2 - position) - 0.8 + 0.2 == pytest.approx(effort, abs=1e-2)


def test_a_sagging_supply_takes_more_of_a_heavy_torque(build, moves):
    for angle in (0.3, 1.2):
        log = build(effects={"supply_sag": {"sag": 0.4}}).record(moves.hold(angle))
        position, effort = log.position[-1, 0], log.effort[-1, 0]
        assert effort == pytest.approx(WEIGHT * np.sin(position), abs=1e-2)
        asked = STIFFNESS * (angle - position)
        assert asked / (1 + 0.4 * asked) == pytest.approx(effort, abs=1e-2)
