"""Commands for a trajectory: the model's joints follow it closely, whatever its effects are."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import ModelError, SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.tracking import commands_for, joint_positions, track
from tests.bank import plain
from tests.laws.user_effects import EccentricGear, HoseSpring, SealFriction

SHARE = {  # of the error without, where it is not a tenth at most
    "backlash": 0.5,  # joints fall through the gap
    "profile": 0.5,  # nearly as slow as the motion
    "servo_deadzone": 0.25,  # its jump at zero error
    "pwm_deadband": 0.25,
}
TOO_WEAK = ("torque_saturation", "voltage_limit")  # for the motion


@pytest.mark.parametrize(
    "kind", [*CATALOGUE.values(), HoseSpring, EccentricGear, SealFriction], ids=lambda kind: kind.name
)
def test_the_model_follows_with_any_effect(arm: RobotModel, wanted: Recording, kind: type) -> None:
    model = arm.with_(effects=(plain(arm, kind),))
    found = track(model, wanted)
    before, after = (np.linalg.norm(one) for one in found.errors())
    if kind.name in TOO_WEAK:
        assert found.short.any() and "too weak" in str(found)
    else:
        assert after < SHARE.get(kind.name, 0.1) * before


@pytest.mark.parametrize("rule", ["linear", "hold"])
def test_the_controllers_rule_counts(arm: RobotModel, wanted: Recording, rule: str) -> None:
    before, after = track(arm.with_(command_hold=rule), wanted).errors()
    assert (after < 0.1 * before).all()


def test_commands_keep_limits_and_speeds(arm: RobotModel) -> None:
    """A trajectory at a limit and faster than the joints can go."""
    time = np.arange(0, 1, 0.02)
    steps = np.where(time[:, None] < 0.5, [0.0, 0.0], [2.99, -2.99])
    found = track(arm, Recording("steps", arm.joints, time, steps, command_hold="linear"))
    tree = arm.tree
    assert (found.command >= tree.lower).all() and (found.command <= tree.upper).all()
    assert (np.abs(np.diff(found.command, axis=0)) <= tree.velocity * 0.02 + 1e-9).all()
    assert found.limited.all() and "is limited by" in str(found)


def test_noise_of_the_trajectory_does_not_become_chatter(arm: RobotModel) -> None:
    """At rest, noise of a fifth of a milliradian changes commands by much less than friction's two sides differ."""
    model = arm.with_(effects=(plain(arm, CATALOGUE["coulomb_friction"]),))
    noise = 2e-4 * np.random.default_rng(0).standard_normal((100, 2))
    command = commands_for(model, Recording("rest", arm.joints, np.arange(100) / 50, noise + 0.5))
    sides = 2 * np.array(list(model.effects[0].values["torque"].values())) / model.stiffness
    assert (np.ptp(command, axis=0) < 0.5 * sides).all()


def test_the_written_commands_are_read_as_a_log(arm: RobotModel, wanted: Recording, tmp_path) -> None:
    from embodiedreamer_gym.recordings.plain_csv import read_commands

    found = track(arm, wanted)
    found.save(tmp_path / "commands.csv")
    joints, time, command = read_commands(tmp_path / "commands.csv")
    assert joints == arm.joints
    assert np.allclose(time, wanted.time) and np.allclose(command, found.command, atol=1e-6)
    assert found.as_dict()["joints"]["elbow"]["after"] == pytest.approx(found.errors()[1][1])


def test_what_no_robot_can_do_is_refused(arm: RobotModel, wanted: Recording) -> None:
    with pytest.raises(ModelError, match=r"elbow should be at .* outside its limits"):
        track(arm, wanted.with_(position=wanted.position + np.array([0.0, 3.0])))
    with pytest.raises(SimulationError, match="2 joints"):
        track(RobotModel.load("so101"), wanted)


def test_expected_positions_are_the_joints_not_the_readings(arm: RobotModel, wanted: Recording) -> None:
    model = arm.with_(effects=(plain(arm, CATALOGUE["encoder_offset"]),))
    still = wanted.with_(position=np.tile(wanted.position[:1], (len(wanted.time), 1)))
    found = track(model, still)
    assert np.abs(joint_positions(model, still.with_(command=found.command)) - still.position).max() < 1e-3
