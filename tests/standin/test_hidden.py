"""Each hidden effect shows what physics says it shows; the numbers are worked out by hand on a pendulum."""

import numpy as np
import pytest

from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.motions import multisine
from embodiedreamer_gym.standin.arms import arm_home
from embodiedreamer_gym.standin.hidden import EFFECTS, CommandPath, Hidden, shape_command

WEIGHT = 1.0 * 9.81 * 0.15  # N m at the horizontal: 1 kg, centre at 0.15 m
STIFFNESS = 40.0  # N m/rad of the pendulum


def ends(recording):
    return recording.position[-1, 0], recording.effort[-1, 0]


def resistance(recording, sample=70):
    """What the drive gives beyond gravity and viscous friction (0.2 N m s/rad) on a ramp, N m."""
    gravity = WEIGHT * np.sin(recording.position[sample, 0])
    return recording.effort[sample, 0] - gravity - 0.2 * recording.velocity[sample, 0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_at_zero_an_effect_is_absent(build, span, effect):
    motion = multisine(span(), np.random.default_rng(0), duration=0.3)
    zeros = {name: 0.0 for name in EFFECTS[effect]}
    plain, off = build("arm6").record(motion), build("arm6", effects={effect: zeros}).record(motion)
    np.testing.assert_allclose(off.position, plain.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(off.effort, plain.effort, rtol=0, atol=1e-9)


def test_coulomb_friction_sticks_below_its_level_and_costs_twice_itself_on_return(build, moves):
    level = 0.4
    robot = build(effects={"coulomb_friction": {"torque": level}})
    stuck = robot.record(moves.step(0.0, 0.9 * level / STIFFNESS))
    assert np.ptp(stuck.position) < 1e-6
    moved = robot.record(moves.step(0.0, 1.5 * level / STIFFNESS))
    assert np.ptp(moved.position) > 0.3 * level / STIFFNESS
    there, back = (resistance(robot.record(moves.ramp(-s * 0.1, s * 0.2, 1.0))) for s in (1, -1))
    assert there - back == pytest.approx(2 * level, rel=1e-3)


def test_stribeck_friction_breaks_loose_above_and_slides_at_its_lower_level(build, moves):
    values = {"sliding": 0.2, "extra_static": 0.3, "speed": 0.05}
    robot = build(effects={"stribeck_friction": values})
    assert np.ptp(robot.record(moves.step(0.0, 0.45 / STIFFNESS)).position) < 1e-5
    assert np.ptp(robot.record(moves.step(0.0, 0.55 / STIFFNESS)).position) > 1e-3
    there, back = (resistance(robot.record(moves.ramp(-s * 0.2, s * 0.4, 1.0))) for s in (1, -1))
    assert there - back == pytest.approx(2 * 0.2, rel=1e-3)


def test_load_friction_grows_with_the_torque_carried(build, moves):
    robot = build(effects={"load_friction": {"coefficient": 0.2}})
    wide = {}
    for pose in (0.0, 1.2):
        there = robot.record(moves.ramp(pose - 0.1, 0.2, 1.0))
        back = robot.record(moves.ramp(pose + 0.1, -0.2, 1.0))
        near = [r.effort[np.argmin(np.abs(r.position[20:, 0] - pose)) + 20, 0] for r in (there, back)]
        wide[pose] = near[0] - near[1] - 2 * 0.2 * 0.2
    load = WEIGHT * np.sin(1.2)
    assert wide[0.0] < 0.05
    assert wide[1.2] == pytest.approx((load + 0.04) / 0.8 - (load - 0.04) / 1.2 - 0.08, rel=0.05)


def test_direction_dependent_friction_has_two_levels(build, moves):
    robot = build(effects={"direction_dependent_friction": {"forward": 0.5, "backward": 0.1}})
    assert np.ptp(robot.record(moves.step(0.0, 0.45 / STIFFNESS, 1.0)).position) < 1e-5
    assert resistance(robot.record(moves.ramp(-0.1, 0.2, 1.0))) == pytest.approx(0.5, rel=1e-3)
    assert resistance(robot.record(moves.ramp(0.1, -0.2, 1.0))) == pytest.approx(-0.1, rel=1e-3)


def test_command_delay_shifts_the_whole_motion(build, moves):
    motion = moves.ramp(0.0, 0.5, 0.6)
    plain = build().record(motion)
    late = build(effects={"command_delay": {"seconds": 0.05}}).record(motion)
    np.testing.assert_allclose(late.position[5:], plain.position[:-5], atol=1e-6)
    np.testing.assert_array_equal(late.command, plain.command)


def test_command_lowpass_follows_its_exponential():
    hidden = Hidden({"command_lowpass": {"time_constant": 0.1}}, np.ones(1), 1)
    command = shape_command(lambda t: t[:, None], hidden, 5001, 1e-4)[:, 0]
    t = np.arange(5001) * 1e-4
    np.testing.assert_allclose(command, t - 0.1 * (1 - np.exp(-t / 0.1)), atol=1e-9)


def test_command_rate_limit_ramps_and_in_ticks_it_climbs_stairs():
    def step(t):
        return (t > 0.0)[:, None].astype(float)

    smooth = shape_command(step, Hidden({"command_rate_limit": {"rate": 0.4}}, np.ones(1), 1), 10001, 1e-4)
    assert smooth[-1, 0] == pytest.approx(0.4, abs=1e-3)
    ticks = Hidden({"command_rate_limit": {"tick": 1 / 40, "step": 0.01}}, np.ones(1), 1)
    stairs = shape_command(step, ticks, 10001, 1e-4)[:, 0]
    assert np.unique(stairs.round(9)).size == 41
    assert stairs[-1] == pytest.approx(0.4)
    assert np.diff(stairs).max() == pytest.approx(0.01)


@pytest.mark.parametrize("effect", [{"command_delay": {"seconds": 0.0123}}, {"command_lowpass": {"time_constant": 0.05}},
                                    {"command_rate_limit": {"rate": 0.8}},
                                    {"command_rate_limit": {"tick": 0.025, "step": 0.01}}])  # fmt: skip
def test_a_command_in_stretches_is_shaped_as_the_whole(effect):
    hidden = Hidden(effect, np.ones(1), 1)
    whole = shape_command(lambda t: np.sin(9 * t)[:, None], hidden, 1000, 1e-3)
    path = CommandPath(hidden, 1e-3)
    stretches = [path.shape(lambda t: np.sin(9 * t)[:, None], steps) for steps in (1, 333, 600, 66)]
    np.testing.assert_array_equal(np.concatenate(stretches), whole)
    assert np.abs(whole[:, 0] - np.sin(9e-3 * np.arange(1000))).max() > 0.05


def test_servo_deadzone_ignores_small_errors(build, moves):
    robot = build(effects={"servo_deadzone": {"width": 0.02}})
    assert np.ptp(robot.record(moves.step(0.0, 0.019)).position) < 1e-9
    position, effort = ends(robot.record(moves.hold(0.8)))
    assert effort == pytest.approx(STIFFNESS * (0.8 - position - 0.02), abs=1e-3)
    assert effort == pytest.approx(WEIGHT * np.sin(position), abs=1e-3)


def test_a_servo_deadzone_that_jumps_takes_the_whole_error_beyond(build, moves):
    robot = build(effects={"servo_deadzone": {"width": 0.02, "jump": 1.0}})
    assert np.ptp(robot.record(moves.step(0.0, 0.019)).position) < 1e-9
    position, effort = ends(robot.record(moves.hold(0.8)))
    assert 0.8 - position > 0.02
    assert effort == pytest.approx(STIFFNESS * (0.8 - position), abs=1e-3)


def test_torque_saturation_caps_the_effort(build, moves):
    fast = moves.step(0.0, 0.5)
    assert np.abs(build().record(fast).effort).max() > 5
    capped = build(effects={"torque_saturation": {"limit": 1.0}}).record(fast)
    assert np.abs(capped.effort).max() == pytest.approx(1.0, abs=1e-9)


def test_voltage_limit_holds_in_its_direction_only(build, moves):
    robot = build(effects={"voltage_limit": {"forward": 0.5}})
    there, back = robot.record(moves.step(-0.5, 1.0, 3.0)), robot.record(moves.step(0.5, -1.0, 3.0))
    assert 0.45 < there.velocity.max() < 0.53
    assert back.velocity.min() < -1.5
    assert there.effort[30:150].max() < 1  # the drive has no more torque to give, and the log shows it
    assert there.position[-1, 0] == pytest.approx(build().record(moves.hold(0.5)).position[-1, 0], abs=2e-3)


def test_voltage_limit_with_a_stall_torque_fades_with_speed(build, moves):
    values = {"forward": 2.0, "backward": 1.0, "stall_torque": 4.0}
    log = build(effects={"voltage_limit": values}).record(moves.step(-0.5, 1.0, 1.0))
    behind = STIFFNESS * (log.command - log.position) - 1.5 * log.velocity > 4.0
    assert behind.sum() > 10
    np.testing.assert_allclose(log.effort[behind], 4.0 * (1 - log.velocity[behind] / 2.0), atol=5e-3)


def test_torque_bias_and_joint_spring_shift_the_rest_pose(build, moves):
    flat = STIFFNESS + WEIGHT  # gravity stiffens the hanging pendulum
    position, effort = ends(build(effects={"torque_bias": {"torque": 0.2}}).record(moves.hold(0.0)))
    assert position == pytest.approx(0.2 / flat, rel=1e-3)
    assert effort == pytest.approx(-STIFFNESS * position, rel=1e-3)
    spring = {"joint_spring": {"stiffness": 2.0, "angle": 0.3}}
    position, _ = ends(build(effects=spring).record(moves.hold(0.0)))
    assert position == pytest.approx(2.0 * 0.3 / (flat + 2.0), rel=1e-3)


def test_payload_adds_its_weight_at_its_place(build):
    extra = build(effects={"payload": {"mass": 0.5, "z": -0.1}}).gravity_torque([[0.7]])
    assert extra - build().gravity_torque([[0.7]]) == pytest.approx(0.5 * 9.81 * 0.4 * np.sin(0.7), rel=1e-6)
    assert build(effects={"payload": {"mass": 0.5}}).moving_mass == pytest.approx(1.5, abs=1e-4)


def test_base_tilt_turns_gravity(build):
    pitched = build(effects={"base_tilt": {"pitch": 0.2, "roll": 0.0}})
    assert pitched.gravity_torque([[0.0]])[0, 0] == pytest.approx(WEIGHT * np.sin(0.2), rel=1e-5)
    rolled = build(effects={"base_tilt": {"roll": 0.2}})
    assert rolled.gravity_torque([[0.5]])[0, 0] == pytest.approx(WEIGHT * np.cos(0.2) * np.sin(0.5), rel=1e-5)
    waist = build("arm6", effects={"base_tilt": {"roll": 0.1}}).gravity_torque(arm_home("arm6"))[0, 0]
    assert abs(waist) > 0.1  # a vertical axis feels it


def test_encoder_offset_is_measured_and_steered_by(build, moves):
    position, effort = ends(build(effects={"encoder_offset": {"angle": 0.1}}).record(moves.hold(0.5)))
    assert effort == pytest.approx(WEIGHT * np.sin(position - 0.1), rel=1e-3)
    assert position == pytest.approx(0.5 - effort / STIFFNESS, rel=1e-3)


def test_quadratic_drag_and_ripple(build, moves):
    drag = build(effects={"quadratic_drag": {"coefficient": 0.5}}).record(moves.ramp(-0.5, 1.0, 1.0))
    assert resistance(drag) == pytest.approx(0.5 * drag.velocity[70, 0] ** 2, rel=0.01)
    ripple = build(effects={"torque_ripple": {"amplitude": 0.3, "frequency": 10.0, "phase": np.pi / 2}})
    position, effort = ends(ripple.record(moves.hold(0.0)))
    assert effort == pytest.approx(WEIGHT * np.sin(position) - 0.3 * np.cos(10 * position), abs=1e-3)


def test_hysteresis_gives_way_before_it_slides(build, moves):
    """Below its level the joint turns by what the bristles give; on a ramp the whole level counts."""
    robot = build(effects={"hysteresis": {"torque": 0.4, "travel": 0.02}})
    nudged = robot.record(moves.step(0.0, 0.002))
    stiffer = STIFFNESS + WEIGHT + 0.4 / 0.02
    assert np.ptp(nudged.position) > 0
    assert nudged.position[-1, 0] == pytest.approx(STIFFNESS * 0.002 / stiffer, rel=0.05)
    there, back = (resistance(robot.record(moves.ramp(-s * 0.2, s * 0.4, 1.0))) for s in (1, -1))
    assert there - back == pytest.approx(2 * 0.4, rel=1e-3)
    still = robot.record(moves.hold(0.5))
    assert np.ptp(still.position) < 1e-5  # what it carried when the arm came to rest it still carries


def test_a_torque_constant_shows_in_the_effort(build, moves):
    plain, strong = build(), build(effects={"torque_constant": {"gain": 4.0}})
    position, effort = ends(strong.record(moves.hold(0.8)))
    assert 4 * effort == pytest.approx(WEIGHT * np.sin(position), abs=1e-3)
    stiff = build(stiffness=4 * STIFFNESS, damping=4 * 1.5).record(moves.step(0.0, 0.3))
    alike = strong.record(moves.step(0.0, 0.3))
    np.testing.assert_allclose(alike.position, stiff.position, atol=1e-6)
    assert np.abs(plain.record(moves.step(0.0, 0.3)).position - alike.position).max() > 0.01


def test_a_drive_fades_from_the_beginning_of_each_motion(build, moves):
    robot = build(effects={"torque_fade": {"loss": 0.5, "time": 1.0}})
    for _ in range(2):
        log = robot.record(moves.hold(0.8, seconds=2.0))
        weight = WEIGHT * np.sin(log.position[:, 0])
        assert log.effort[0, 0] == pytest.approx(weight[0], rel=1e-3)
        assert log.effort[-1, 0] * (1 - 0.5 * (1 - np.exp(-2.0))) == pytest.approx(weight[-1], rel=5e-3)


def test_rotor_inertia_adds_to_the_rotors_own(build, moves):
    extra = build(effects={"rotor_inertia": {"inertia": 0.05}}).record(moves.step(0.0, 0.3))
    own = build(rotor_inertia=0.01 + 0.05).record(moves.step(0.0, 0.3))
    np.testing.assert_allclose(extra.position, own.position, atol=1e-9)


def test_behind_a_soft_gear_the_link_sags_unseen_by_the_encoder(build, moves):
    soft = {"compliance": 0.02, "settling": 0.01}
    position, effort = ends(build(effects={"joint_elasticity": soft}).record(moves.hold(0.8)))
    assert effort == pytest.approx(STIFFNESS * (0.8 - position), abs=1e-3)
    assert effort == pytest.approx(WEIGHT * np.sin(position - 0.02 * effort), abs=1e-3)


def test_in_a_gap_the_servo_moves_its_motor_alone(build, moves):
    robot = build(effects={"backlash": {"gap": 0.06}})
    inside = robot.record(moves.step(0.0, 0.02))
    assert inside.position[-1, 0] == pytest.approx(0.02, abs=1e-4)
    assert inside.effort[-1, 0] == pytest.approx(0.0, abs=2e-3)  # no weight: the link still hangs straight down
    position, effort = ends(robot.record(moves.hold(0.8)))
    assert effort == pytest.approx(WEIGHT * np.sin(position - 0.03), abs=2e-3)


def test_friction_never_adds_energy(build, moves):
    """After a step, a joint with any friction swings less than one without."""
    step = moves.step(0.0, 0.3)
    free = build(damping=0.3).record(step).position.max()
    for effects in (
        {"coulomb_friction": {"torque": 0.2}},
        {"stribeck_friction": {"sliding": 0.1, "extra_static": 0.1, "speed": 0.1}},
        {"load_friction": {"coefficient": 0.1}},
        {"quadratic_drag": {"coefficient": 0.1}},
        {"hysteresis": {"torque": 0.2, "travel": 0.02}},
    ):
        assert build(damping=0.3, effects=effects).record(step).position.max() < free


def test_unknown_names_and_shapes_are_refused(build):
    with pytest.raises(EffectError, match="no effect 'ghost'; it has command_delay"):
        build(effects={"ghost": {}})
    with pytest.raises(EffectError, match="no parameter 'torq'; it has torque"):
        build(effects={"coulomb_friction": {"torq": 1.0}})
    with pytest.raises(EffectError, match="must be a finite number or 1 of them"):
        build(effects={"coulomb_friction": {"torque": [1.0, 2.0]}})
    with pytest.raises(EffectError, match="needs a speed above zero"):
        build(effects={"stribeck_friction": {"extra_static": 1.0}})
    with pytest.raises(EffectError, match="needs a travel above zero"):
        build(effects={"hysteresis": {"torque": 1.0}})
    with pytest.raises(EffectError, match="needs a time above zero"):
        build(effects={"torque_fade": {"loss": 0.5}})


def test_timestamp_jitter_changes_the_stamps_alone(build, moves):
    motion = moves.ramp(0.0, 0.5, 0.6)
    plain, jittered = build().record(motion), build(effects={"timestamp_jitter": {"seconds": 0.002}}).record(motion)
    np.testing.assert_array_equal(jittered.position, plain.position)
    assert np.std(jittered.time - plain.time) == pytest.approx(0.002, rel=0.2)
