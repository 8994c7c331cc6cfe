from dataclasses import asdict

import numpy as np
import pytest

from embodiedreamer_gym.errors import ModelError, RecordingError, SimulationError
from embodiedreamer_gym.motions import Motion, multisine, slow_ramps
from embodiedreamer_gym.standin.arms import TRUTH, arm_joints, arm_urdf
from embodiedreamer_gym.standin.robot import StandIn

GRIPPER = """<robot name="gripper"><link name="base"/>
<link name="hand"><inertial><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="left"><inertial><origin xyz="0 0.02 0"/><mass value="0.05"/>
<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
<link name="right"><inertial><origin xyz="0 -0.02 0"/><mass value="0.05"/>
<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
<joint name="wrist" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="9" velocity="3"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="9" velocity="1"/></joint>
<joint name="follower" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.04" effort="9" velocity="1"/><mimic joint="grip" multiplier="1" offset="0"/></joint>
</robot>"""


def gripper(**changes):
    given = {
        "stiffness": (20, 1.6),
        "damping": (1, 0.1),
        "rotor_inertia": (0.01, 0.0004),
        "viscous_friction": (0.1, 0.0),
        "normalised": {"grip": (0.0, 0.04)},
        "timestep": 2e-4,
    }
    return StandIn(GRIPPER, ("wrist", "grip"), **{**given, **changes})


def test_a_log_is_a_valid_recording_with_the_declared_sensor(build, span):
    motion = multisine(span(), np.random.default_rng(0), duration=1.0)
    sensor = {"noise": 4e-4, "quantum": 2 * np.pi / 4096, "jitter": 5e-4, "effort_noise": 0.02}
    log = build("arm6").record(motion, **sensor)
    assert log.joints == arm_joints("arm6")
    assert log.position.shape == log.command.shape == log.velocity.shape == log.effort.shape == (101, 6)
    assert (log.kind, log.command_hold, log.units) == ("multisine", "unknown", ("rad",) * 6)
    steps = log.position / (2 * np.pi / 4096)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    np.testing.assert_allclose(log.command, motion(np.arange(101) / 100))
    assert 2e-4 < np.std(log.time - np.arange(101) / 100) < 8e-4


def test_noise_has_the_size_asked_for(build, moves):
    quiet, noisy = build("arm6"), build("arm6")
    motion = moves.hold(0, -0.9, 1.4, 0, 0.3, 0, seconds=4.0)
    exact = quiet.record(motion, with_effort=False)
    assert exact.effort is None
    log = noisy.record(motion, noise=1e-3, effort_noise=0.02, velocity_noise=0.05)
    assert np.std(log.position - exact.position) == pytest.approx(1e-3, rel=0.1)
    assert np.std(log.velocity) == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(np.std(log.effort, axis=0), 0.02 * 0.05 * np.array(TRUTH["arm6"].stiffness), rtol=0.15)


def test_a_seed_gives_one_robot_and_one_log(span):
    errors = {"mass_error": 0.015, "com_error": 0.002, "gain_error": 0.05, "viscous_error": 0.25}
    motion = multisine(span(), np.random.default_rng(0), duration=0.3)

    def log(seed):
        servo, rng = asdict(TRUTH["arm6"]), np.random.default_rng(seed)
        robot = StandIn(arm_urdf("arm6"), arm_joints("arm6"), **servo, rng=rng, timestep=2e-4, **errors)
        return robot.true, robot.moving_mass, robot.record(motion, noise=1e-4).position

    (servo, mass, first), (_, _, again), (_, _, other) = log(1), log(1), log(2)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3
    ratio = servo["stiffness"] / TRUTH["arm6"].stiffness
    assert 0.95 <= ratio.min() < ratio.max() <= 1.05
    assert 4.1 * 0.985 < mass < 4.1 * 1.015
    assert mass != pytest.approx(4.1, abs=1e-6)


def test_starts_at_rest_under_gravity(build, span):
    motion = slow_ramps(span(), np.random.default_rng(0), duration=0.2)
    still = Motion(lambda t: np.tile(motion(0.0), (len(t), 1)), 0.3, "hold")
    robot = build("arm6")
    log = robot.record(still)
    assert np.ptp(log.position, axis=0).max() < 1e-5
    np.testing.assert_allclose(log.effort[-1], robot.gravity_torque(log.position[-1:])[0], atol=1e-3)
    np.testing.assert_allclose(log.effort, robot.true["stiffness"] * (log.command - log.position), atol=1e-3)


def test_a_tenth_of_a_millisecond_is_converged(build, span):
    motion = multisine(span(), np.random.default_rng(0), duration=1.0)
    coarse, fine = (build("arm6", timestep=dt).record(motion) for dt in (1e-4, 5e-5))
    assert np.abs(coarse.position - fine.position).max() < 2e-6
    assert np.abs(coarse.effort - fine.effort).max() < 2e-3


def test_sampling_between_steps(build, span):
    motion = multisine(span(), np.random.default_rng(0), duration=1.0)
    robot = build("arm6")
    dense = robot.record(motion, hz=600.0)
    log = robot.record(motion, hz=30.0)
    np.testing.assert_allclose(log.position, dense.position[::20], atol=1e-6)


def test_what_the_controller_makes_of_the_logged_commands(build, moves):
    ramp = moves.ramp(0.0, 1.0, 1.0)
    robot = build()
    smooth, straight, stairs = (
        robot.record(ramp, hz=30.0, command_known=known, declare="hold") for known in ("continuous", "linear", "hold")
    )
    np.testing.assert_allclose(straight.position, smooth.position, atol=1e-9)
    assert np.mean(smooth.position[10:] - stairs.position[10:]) == pytest.approx(1 / 60, rel=0.1)
    assert stairs.command_hold == "hold"


def test_a_normalised_gripper_is_logged_in_strokes():
    log = gripper().record(Motion(lambda t: np.stack([0 * t, np.minimum(t, 0.8)], axis=1), 1.5, "close"))
    assert log.units == ("rad", "1")
    assert log.position[-1, 1] == pytest.approx(0.8, abs=2e-3)
    assert 0.9 < log.velocity[40:70, 1].mean() < 1.1
    # while it closes at 1 stroke/s: the servo pushes against its own damping only
    np.testing.assert_allclose(log.effort[40:70, 1], 0, atol=5e-3)


def test_the_other_finger_follows():
    robot = gripper()
    robot.record(Motion(lambda t: np.stack([0.5 * np.sin(5 * t), 0.5 + 0.4 * np.sin(8 * t)], axis=1), 0.7, "both"))
    q = robot._engine._data.qpos
    assert q[1] > 0.005
    assert q[2] == pytest.approx(q[1], abs=1e-6)


def test_gravity_on_both_fingers_cancels_when_the_hand_lies_on_its_side():
    held = gripper().gravity_torque([[np.pi / 2, 0.5]])[0]
    assert held[1] == pytest.approx(0.0, abs=1e-9)
    lone = StandIn(GRIPPER.replace('<mimic joint="grip" multiplier="1" offset="0"/>', ""), ("grip",), 2, 0.1, 0.01, 0)
    assert lone.units == ("m",)


def test_two_arms_get_their_own_tilt_and_payload():
    one = arm_urdf("pendulum1").split("\n", 2)[2].removesuffix("</robot>\n")
    names = ("base", "link1", "joint1", "tip_mount", "tip")
    both = '<robot name="two"><link name="world"/>'
    for side in ("left", "right"):
        text = one
        for name in names:
            text = text.replace(f'"{name}"', f'"{side}_{name}"')
        both += text + f'<joint name="{side}" type="fixed"><parent link="world"/><child link="{side}_base"/></joint>'
    effects = {"base_tilt": {"pitch": [0.1, 0.0]}, "payload": {"mass": [0.0, 0.2]}}
    servo = {"stiffness": 40, "damping": 1.5, "rotor_inertia": 0.01, "viscous_friction": 0.2}
    robot = StandIn(both + "</robot>", ("left_joint1", "right_joint1"), **servo, effects=effects)
    assert robot.end_effectors == ("left_tip", "right_tip")
    held = robot.gravity_torque([[0.0, 0.5]])[0]
    assert held == pytest.approx([9.81 * 0.15 * np.sin(0.1), 9.81 * (0.15 + 0.06) * np.sin(0.5)], rel=1e-4)


def test_faults_of_the_caller_are_named(build, moves, tmp_path):
    with pytest.raises(ModelError, match="no joint elbow; it has joint1"):
        StandIn(arm_urdf("arm6"), ("elbow",), 1, 1, 1, 1)
    with pytest.raises(ModelError, match="does not exist"):
        StandIn(tmp_path / "none.urdf", ("a",), 1, 1, 1, 1)
    with pytest.raises(ModelError, match="is not XML"):
        StandIn("<robot", ("a",), 1, 1, 1, 1)
    with pytest.raises(ModelError, match="its root is <sdf>, not <robot>"):
        StandIn("<sdf/>", ("a",), 1, 1, 1, 1)
    with pytest.raises(ModelError, match="value at 1 that is above"):
        gripper(normalised={"grip": (0.04, 0.0)})
    with pytest.raises(RecordingError, match="motion has 1 joints but the stand-in has 6"):
        build("arm6").record(moves.hold(0.0))
    with pytest.raises(SimulationError, match="does not rest"):
        build(damping=0.0, viscous_friction=0.0).record(moves.hold(1.0))
