"""The independent generator of cases: no law of the package in it, the same case for a seed, and faults that show."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks import diagnosis_cases, independent
from benchmarks.diagnosis_cases import SETS, labels
from benchmarks.independent.arms import ARMS, DESK5
from benchmarks.independent.cases import (
    AS_A_PERSON,
    EXCITING,
    FAMILIES,
    FAULTS,
    SINGLES,
    IndependentCase,
    Sensors,
    Yardstick,
    choose,
    draw,
    draw_robot,
)
from benchmarks.independent.motions import KINDS
from benchmarks.independent.outside import OUTSIDE
from benchmarks.independent.plant import nominal
from benchmarks.independent.rollout import Logger, simulate
from embodiedreamer_gym import calibrate, compare
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel

FOLDER = Path(independent.__file__).parent
SHORT = Logger(2.0, 100.0, hold=False)


def test_nothing_of_the_packages_laws_is_imported():
    used = set()
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                used |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, path
                used |= {f"{node.module}.{alias.name}" for alias in node.names}
    own = {name for name in used if name.startswith("embodiedreamer_gym")}
    assert own == {"embodiedreamer_gym.recordings.Recording", "embodiedreamer_gym.recordings.save_recording"}
    rest = {name.split(".")[0] for name in used - own} - {"benchmarks"}
    assert rest <= {"__future__", "collections", "dataclasses", "functools", "json", "mujoco", "numpy", "pathlib"}
    assert all(name.startswith("benchmarks.independent") for name in used if name.startswith("benchmarks"))


def test_singles_are_of_the_catalogue_and_the_others_are_not():
    assert set(SINGLES) <= set(CATALOGUE) and not set(OUTSIDE) & set(CATALOGUE)
    assert sorted(SINGLES) == sorted(name for family in FAMILIES for name in family)
    for name in ("independent", "independent_teleoperation"):
        for label in labels(name, "test"):
            assert set(label.effects) <= set(OUTSIDE if label.kind == "outside" else SINGLES)
            assert label.kind == "null" or 3.0 <= label.strength <= 60.0
            if label.kind == "pair":
                assert not any(set(label.effects) <= set(family) for family in FAMILIES)
    asked = labels("independent", "test")
    assert {e for label in asked if label.kind == "single" for e in label.effects} == set(SINGLES)
    assert {label.arm for label in asked} == set(ARMS)


@pytest.mark.parametrize("name", ["independent", "independent_teleoperation"])
def test_a_case_is_the_same_for_a_seed(name, monkeypatch):
    short = {n: replace(d, recording=dict(d.recording) | {"seconds": 1.0}) for n, d in SETS.items() if d.independent}
    monkeypatch.setattr(diagnosis_cases, "SETS", short)
    label = next(label for label in labels(name, "test") if label.effects == ("payload",))
    first, second = (diagnosis_cases.draw(name, "test", label) for _ in range(2))
    other = diagnosis_cases.draw(name, "development", label)
    assert isinstance(first, IndependentCase) and isinstance(second, IndependentCase)
    assert first.hidden == second.hidden != other.hidden
    for a, b in zip((*first.train, *first.test), (*second.train, *second.test), strict=True):
        assert np.array_equal(a.position, b.position) and a.effort is not None
        assert np.array_equal(np.asarray(a.effort), np.asarray(b.effort))


@pytest.fixture(scope="module")
def yardstick():
    rng = np.random.default_rng(3)
    robot = draw_robot(DESK5, rng)
    return Yardstick(robot, [KINDS["point_to_point"](DESK5, rng, 2.0)], SHORT, 0.5e-3)


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_changes_the_motion_and_vanishes_with_its_size(name, yardstick):
    at, shares = np.array([1, 2]), np.random.default_rng(1).random((5, 4))
    strong = FAULTS[name](DESK5, at, shares, 0.8)
    assert yardstick(strong) > 1.0
    assert yardstick(FAULTS[name](DESK5, at, shares, 1e-6)) < 0.2
    hidden = strong.values()
    named = {joint for row in hidden.values() for joint in row}
    assert named == ({"tip"} if strong.per_arm else {"lift", "elbow"})
    if name in ("payload", "torque_bias", "coulomb_friction", "command_delay", "backlash", "joint_elasticity"):
        assert set(hidden) <= {parameter.name for parameter in CATALOGUE[name].parameters}


def test_a_fault_is_made_as_visible_as_wanted(yardstick):
    for wanted in (4.0, 40.0):
        fault, seen = choose(FAULTS["coulomb_friction"], wanted, yardstick, np.random.default_rng(0))
        assert seen == yardstick(fault) and wanted / 1.25 <= seen <= wanted * 1.25


def test_the_servo_carries_the_weight_as_a_spring_does():
    robot = nominal(DESK5)
    home = DESK5.each("home")
    still = simulate(robot, [], lambda t: np.tile(home, (len(t), 1)), replace(SHORT, seconds=0.2))
    assert np.ptp(still.position, axis=0).max() < 1e-5
    assert still.effort[-1] == pytest.approx(robot.stiffness * (home - still.position[-1]), rel=0.01, abs=1e-4)
    assert abs(still.effort[-1][1]) > 0.3 > abs(still.effort[-1][0])  # the lift carries weight, the pan none


def test_commands_between_samples_are_held_or_linear():
    def ramp(time):
        return np.asarray(time)[:, None] * np.ones(2)

    held, linear = (Logger(0.1, 50.0, hold).commands(ramp) for hold in (True, False))
    assert held[19] == pytest.approx(0.0) and held[20] == pytest.approx(0.02) and held[39] == pytest.approx(0.02)
    assert linear[30] == pytest.approx(0.03)


def test_an_encoder_rounds_to_its_step():
    case = draw((), "desk5", 0.0, np.random.default_rng(2), seconds=1.0)
    steps = case.train[0].position / Sensors(0.0, 14).quantum
    assert np.allclose(steps, np.round(steps), atol=1e-6)


@pytest.mark.parametrize("kinds", [EXCITING, AS_A_PERSON])
def test_a_faultless_arm_fits_a_calibrated_model_to_near_the_noise(kinds, tmp_path):
    case = draw((), "desk5", 0.0, np.random.default_rng(8), kinds, 100.0 if "sines" in kinds else 30.0, 3.0)
    model = RobotModel.load(case.write(tmp_path))
    train, test = (load_recordings(f"{tmp_path}/{part}") for part in ("train", "test"))
    assert compare(calibrate(model, train).model, test).error[0] < 1.6 * np.mean([log.sigma for log in test])


def test_the_files_do_not_tell_what_is_hidden(tmp_path):
    case = draw(("payload", "backlash"), "servo6", 20.0, np.random.default_rng(4), seconds=1.0)
    case.write(tmp_path)
    text = " ".join(path.read_text() for path in tmp_path.rglob("*") if path.is_file())
    assert "payload" not in text and "backlash" not in text and set(case.visibility) == {"payload", "backlash"}


def test_an_offset_about_a_vertical_axis_shows_nothing():
    robot, logger = nominal(DESK5), Logger(1.0, 100.0, False)
    yardstick = Yardstick(robot, [KINDS["sines"](DESK5, np.random.default_rng(0), 1.0)], logger, 3e-4)
    fault = FAULTS["encoder_offset"](DESK5, np.array([0, 1]), np.full((5, 4), 0.7), 0.5)
    shown = yardstick.by_joint(fault)
    assert list(shown) == list(DESK5.names[:2]) and shown["pan"] < 0.5 and shown["lift"] > 5
    assert yardstick.by_joint(FAULTS["payload"](DESK5, np.array([0]), np.full((5, 4), 0.7), 0.5)) == {}
