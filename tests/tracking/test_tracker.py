"""Commands period by period: feed-forward, trim, reference robots and limits."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import Drive
from embodiedreamer_gym.tracking import Tracker
from tests.bank import plain
from tests.tracking.conftest import HZ

STEPS = 5  # of the plant in a period
RESTED = 400  # steps in which the arm comes to rest at first


def play(tracker: Tracker, robot: RobotModel, actions: np.ndarray, chunk: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Positions and commands (T, n) of a robot that hears a tracker's commands on a ramp."""
    drive, start = Drive(robot, dt=1 / HZ / STEPS), actions[0]
    drive.start(start[None], np.zeros((1, 2)), start[None])
    for _ in range(RESTED):
        drive.advance(drive.accelerate(start[None]))
    tracker.reset(drive.read()[0], start)
    before, places, sent = start, [], []
    for k, action in enumerate(actions):
        if k % chunk == 0:
            tracker.preview(actions[k : k + chunk])
        command = tracker.command(action, drive.read()[0])
        for step in range(1, STEPS + 1):
            drive.advance(drive.accelerate((before + (command - before) * step / STEPS)[None]))
        before = command
        places.append(drive.position[0])
        sent.append(command)
    return np.array(places), np.array(sent)


def error(places: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.sqrt(np.mean((places - wanted) ** 2)))


@pytest.fixture
def rough(arm: RobotModel) -> RobotModel:
    """The arm with friction and a delay."""
    return arm.with_(effects=tuple(plain(arm, CATALOGUE[name]) for name in ("coulomb_friction", "command_delay")))


def test_each_part_helps_and_a_chunk_more(rough: RobotModel, wanted: Recording) -> None:
    path = wanted.position
    off, forward, trim = (
        error(play(Tracker(rough, HZ, m), rough, path)[0], path) for m in ("off", "feed_forward", "trim")
    )
    whole = error(play(Tracker(rough, HZ, "feed_forward"), rough, path, chunk=20)[0], path)
    assert whole < forward < off / 4 and trim < off
    assert whole < off / 7


def test_the_trim_takes_what_the_model_does_not_know(rough: RobotModel, wanted: Recording) -> None:
    """A payload that the model has not."""
    path, heavy = wanted.position, rough.with_effect(plain(rough, CATALOGUE["payload"]))
    forward, both = (error(play(Tracker(rough, HZ, m), heavy, path, 20)[0], path) for m in ("feed_forward", "both"))
    assert both < 0.8 * forward


def test_a_reference_that_is_the_model_changes_little(arm: RobotModel, wanted: Recording) -> None:
    """The robot is where its own commands bring it already."""
    sent = play(Tracker(arm, HZ, "feed_forward", reference=arm), arm, wanted.position)[1]
    assert np.abs(sent - wanted.position).max() < 0.03
    plainly = play(Tracker(arm, HZ, "off"), arm, wanted.position)[0]
    assert error(play(Tracker(arm, HZ, "feed_forward", reference=arm), arm, wanted.position)[0], plainly) < 2e-3


def test_a_reference_brings_another_robot_where_it_would_be(
    arm: RobotModel, rough: RobotModel, wanted: Recording
) -> None:
    there = play(Tracker(arm, HZ, "off"), arm, wanted.position)[0]
    without = error(play(Tracker(rough, HZ, "off"), rough, wanted.position)[0], there)
    assert error(play(Tracker(rough, HZ, "both", reference=arm), rough, wanted.position)[0], there) < without / 3


def test_a_policy_of_the_reference_sees_its_readings(arm: RobotModel, rough: RobotModel, wanted: Recording) -> None:
    """At rest, where friction holds the robot, and in motion; a deviation of the robot is visible to the policy."""
    tracker, command = Tracker(rough, HZ, "both", reference=arm), wanted.position[0]
    resting, moving = Drive(arm, dt=1 / HZ / 5), Drive(arm, dt=1 / HZ / 5)
    for drive in (resting, moving):
        drive.start(command[None], np.zeros((1, 2)), command[None])
        for _ in range(2000):
            drive.advance(drive.accelerate(command[None]))
    stuck, pushed = resting.read()[0] + 0.05, np.array([0.0, 0.1])
    tracker.reset(stuck, command)
    np.testing.assert_allclose(tracker.observed(stuck), resting.read()[0], atol=1e-3)
    np.testing.assert_allclose(tracker.observed(stuck + pushed), resting.read()[0] + pushed, atol=1e-3)
    assert np.array_equal(Tracker(rough, HZ, "both").observed(stuck), stuck)
    before, places = command, play(tracker, rough, wanted.position[:40])[0]
    for action in wanted.position[:40]:
        for k in range(1, 6):
            moving.advance(moving.accelerate((before + (action - before) * k / 5)[None]))
        before = action
    assert np.abs(tracker.observed(places[-1]) - moving.read()[0]).max() < 5e-3


def test_off_has_no_reference(arm: RobotModel, rough: RobotModel, wanted: Recording) -> None:
    """The action is sent as it is, so the policy sees what this robot's encoders read."""
    tracker = Tracker(rough, HZ, "off", reference=arm)
    places, sent = play(tracker, rough, wanted.position[:20])
    assert np.array_equal(sent, wanted.position[:20]) and np.array_equal(tracker.observed(places[-1]), places[-1])


def test_commands_keep_limits_and_speeds(arm: RobotModel) -> None:
    jump = np.repeat([[0.0, 0.0], [5.0, -5.0]], 20, axis=0)
    sent = play(Tracker(arm, HZ, "both"), arm, jump)[1]
    assert (sent <= arm.tree.upper).all() and (sent >= arm.tree.lower).all()
    assert (np.abs(np.diff(sent, axis=0)) <= arm.tree.velocity / HZ + 1e-9).all()


def test_off_is_the_action_itself(rough: RobotModel, wanted: Recording) -> None:
    assert np.array_equal(play(Tracker(rough, HZ, "off"), rough, wanted.position)[1], wanted.position)


def test_what_cannot_be_is_refused(arm: RobotModel) -> None:
    with pytest.raises(ModelError, match="mode 'on' is not one of off, feed_forward"):
        Tracker(arm, HZ, "on")
    with pytest.raises(ModelError, match="different joints"):
        Tracker(arm, HZ, reference=RobotModel.load("so101"))
