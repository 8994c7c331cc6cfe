"""The session: actions without a page, their undo, their errors, and the same state when they are done again."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import compare
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.workbench import trial
from embodiedreamer_gym.workbench.actions import Actions
from embodiedreamer_gym.workbench.session import Session
from tests.two_joint_arm import load_arm, record
from tests.workbench.random_actions import random_actions

EFFECT = "coulomb_friction"


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The faultless arm and recordings of the arm with friction."""
    model = load_arm(tmp_path_factory.mktemp("arm"))
    true = model.with_effect(EFFECT).with_values({f"{EFFECT}.torque": {"shoulder": 0.6, "elbow": 0.2}})
    return model, [record(true, f"wave_{k}", 5e-4, seed=k) for k in range(4)]


@pytest.fixture
def session(arm, tmp_path):
    model, logs = arm
    return Session(model, logs[:2], logs[2:], tmp_path / "better.json")


def test_the_error_is_that_of_compare(arm, session) -> None:
    model, logs = arm
    assert session.error == compare(model, logs[2:]).error[0]
    session.do("set_effect", name=EFFECT)
    assert session.error == compare(model, logs[2:]).error[0]  # off at first
    session.do("set_size", parameter=f"{EFFECT}.torque", size=0.4)
    assert session.error == compare(session.model, logs[2:]).error[0] != session.staircase[0][1]


def test_a_drag_is_undone_as_a_whole(session) -> None:
    session.do("set_effect", name=EFFECT)
    off = session.state
    for size in (0.1, 0.2, 0.3):
        session.do("set_size", parameter=f"{EFFECT}.torque", size=size)
    session.do("set_size", parameter=f"{EFFECT}.torque", size=0.1, place="elbow")
    dragged = session.state
    session.do("undo")
    session.do("undo")
    assert session.state is off
    session.do("redo")
    session.do("redo")
    assert session.state is dragged
    with pytest.raises(EmbodieDreamerError, match="nothing to redo"):
        session.do("redo")


def test_a_slider_covers_the_range_of_every_parameter(arm) -> None:
    model, _ = arm
    for name in model.catalogue:
        for row in trial.with_trial(model, name, model.joints).parameters().of_effect(name):
            low, high = trial.reach(row)
            ends = trial.value_of(row, low), trial.value_of(row, high)
            assert ends == pytest.approx((row.low, row.high), rel=1e-9, abs=1e-12)
            assert trial.value_of(row, trial.size_of(row)) == pytest.approx(row.value, abs=1e-9 * (row.high - row.low))


@pytest.mark.parametrize(
    ("action", "given"), [("set_joints", {"joints": ["shoulder"]}), ("set_joint", {"joint": "elbow", "on": False})]
)
def test_joints_keep_their_values(session, action: str, given: dict) -> None:
    session.do("set_effect", name=EFFECT)
    session.do("set_value", parameter=f"{EFFECT}.torque", value=0.3)
    session.do(action, **given)
    rows = session.model.parameters().of_effect(EFFECT)
    assert [(r.key.place, r.value) for r in rows] == [("shoulder", 0.3)]


def test_fit_finds_the_friction_and_the_staircase_falls(session) -> None:
    session.do("set_effect", name=EFFECT)
    session.do("set_size", parameter=f"{EFFECT}.torque", size=0.3)
    session.do("fit")
    found = {r.key.place: r.value for r in session.model.parameters().of_effect(EFFECT)}
    assert found == pytest.approx({"shoulder": 0.6, "elbow": 0.2}, rel=0.1)
    session.do("keep")
    labels, errors = zip(*session.staircase, strict=True)
    assert labels == ("nominal", f"+ {EFFECT}, fitted") and errors[1] < 0.2 * errors[0]
    assert errors[1] == pytest.approx(session.measure.signals.sigma.mean(), rel=0.2)


def test_a_jump_goes_to_the_largest_error(session) -> None:
    session.do("jump", joint="elbow", regime="all")
    run = session.measure.run(session.model)
    largest = max(np.abs(e[:, 1]).max() for e in run.errors)
    at = int(np.argmin(np.abs(session.recording.time - session.recording.time[0] - session.time)))
    error = session.recording.position[at, 1] - run.rollouts[session.test.index(session.recording)].position[at, 1]
    assert abs(error) == largest and session.joint == "elbow"


def test_accept_writes_the_model_and_what_was_tried(session) -> None:
    session.do("put_on", effect=EFFECT)
    session.do("accept")
    again = RobotModel.load(session.out)
    assert repr(again.parameters()) == repr(session.model.parameters())
    history = json.loads(session.out.with_name("better.history.json").read_text())
    assert [entry["what"] for entry in history["tried"]] == ["put on", "kept"]
    assert history["error"]["steps"] == [list(step) for step in session.staircase]


def test_an_existing_file_is_not_overwritten(session) -> None:
    session.out.write_text("mine")
    with pytest.raises(EmbodieDreamerError, match="exists already"):
        session.do("accept")
    assert session.out.read_text() == "mine" and len(session.state.steps) == 1


@pytest.mark.parametrize(
    ("action", "given"),
    [
        ("fly", {}), ("undo", {}), ("keep", {}), ("take", {}), ("set_effect", {"name": "magic"}),
        ("set_joints", {"joints": ["elbow"]}), ("set_size", {"parameter": f"{EFFECT}.torque", "size": 0.5}),
        ("choose_joint", {"joint": "knee"}), ("choose_recording", {"name": "none"}), ("put_on", {"effect": "magic"}),
        ("jump", {"joint": "elbow", "regime": "asleep"}), ("change", {"new": None}),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_a_sentence_and_changes_nothing(session, action: str, given: dict) -> None:
    before, log = session.state, list(session.log)
    with pytest.raises(EmbodieDreamerError):
        session.do(action, **given)
    assert session.state is before and session.log == log and session.job is None


def test_edits_wait_for_long_work(session) -> None:
    session.start("fit")
    with pytest.raises(EmbodieDreamerError, match="running"):
        session.do("set_effect", name=EFFECT)
    session.do("choose_joint", joint="elbow")
    session.cancel()
    session.do("set_effect", name=EFFECT)


def test_random_actions_end_in_the_state_of_the_same_steps(arm, session) -> None:
    for action, given in random_actions(session, np.random.default_rng(5), 300):
        try:
            session.do(action, **given)
        except EmbodieDreamerError:
            continue
    assert len(session.log) > 150
    model, logs = arm
    again = Session.replay(session.log, model, logs[:2], logs[2:])
    assert repr(again.model.parameters()) == repr(session.model.parameters())
    assert [s.label for s in again.state.steps] == [s.label for s in session.state.steps]
    assert (again.joint, again.recording, again.time) == (session.joint, session.recording, session.time)
    assert again.error == session.error


def test_actions_are_done_in_turn_and_work_can_be_stopped(session) -> None:
    said: list[str] = []
    actions = Actions(session, lambda: None, lambda: None, lambda: actions.stop(), said.append)
    actions.start()
    actions.do("set_effect", name=EFFECT)
    for size in np.linspace(0.0, 0.5, 40):
        actions.do("set_size", parameter=f"{EFFECT}.torque", size=float(size))
    actions.do("keep")
    assert actions.wait(30)
    assert len(session.log) <= 42 and session.log[-1]["action"] == "keep"
    assert session.log[-2]["size"] == 0.5
    before = session.state
    actions.do("fit")  # its first report of progress stops it
    assert actions.wait(30)
    assert said == ["fit: stopped; nothing has changed."] and session.state is before and session.job is None
    actions.close()
