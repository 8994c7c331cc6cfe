"""Robot models: what may be left out, what is refused, what a file keeps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.errors import EffectError, ModelError
from embodiedreamer_gym.robot import RobotModel, built_in_robots
from embodiedreamer_gym.robot.data import SERVO_GROUPS
from embodiedreamer_gym.simulation import simulate
from tests.bank import BUILT_IN, fast, plain, robot
from tests.two_joint_arm import load_arm, write_arm


def test_the_built_in_robots() -> None:
    assert built_in_robots() == ("aloha", "servo", "so101")
    assert [robot(name).n for name in built_in_robots()] == [14, 1, 6]


def test_a_minimal_file_gets_a_first_guess(tmp_path: Path) -> None:
    write_arm(tmp_path)
    path = tmp_path / "bare.json"
    path.write_text('{"robot": {"urdf": "two.urdf", "joints": ["shoulder", "elbow"]}}')
    model = RobotModel.load(path)
    assert model.name == "bare" and model.effects == () and model.given == frozenset()
    assert list(model.tree.tips) == ["tip"], "the outermost link"
    for group in SERVO_GROUPS[:3]:
        assert np.all(getattr(model, group) > 0)
    np.testing.assert_array_equal(model.viscous_friction, 0.0)
    run = simulate(model, fast(model))
    assert np.abs(run.position - fast(model).position).max() < 0.5, "and it follows its commands"


def test_a_servo_group_that_is_left_out_gets_a_first_guess(tmp_path: Path) -> None:
    model = RobotModel.load(write_arm(tmp_path, servo={"stiffness": [60.0, 25.0]}))
    assert model.given == {"stiffness", "rotor_inertia", "viscous_friction"}
    np.testing.assert_allclose(model.damping, model.first_guess()["damping"])


@pytest.mark.parametrize("name", BUILT_IN)
def test_what_is_saved_comes_back(name: str, tmp_path: Path) -> None:
    model = robot(name).with_(command_hold="hold", name="mine")
    for kind in CATALOGUE.values():
        model = model.with_effect(plain(model, kind, 1 / 3))
    rows = model.parameters()
    model = model.with_(intervals={row.name: (row.value / 3, row.value * 3) for row in rows})
    model.save(tmp_path / "b.json")
    back = RobotModel.load(tmp_path / "b.json")
    assert (back.name, back.joints, back.command_hold) == ("mine", model.joints, "hold")
    assert (back.urdf, back.effects, back.intervals) == (model.urdf, model.effects, model.intervals)
    assert (back.normalised, back.end_effectors) == (model.normalised, model.end_effectors)
    assert back.given == model.given
    for group in SERVO_GROUPS:
        np.testing.assert_array_equal(getattr(back, group), getattr(model, group))
    back.save(tmp_path / "c.json")
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "c.json").read_bytes()


def test_what_is_fixed_or_estimated_is_saved(tmp_path: Path) -> None:
    """A calibration's values are not taken for the user's own when they come back."""
    model = load_arm(tmp_path).with_effect("coulomb_friction")
    model = model.with_(given=frozenset({"stiffness"})).with_fixed("gains", "friction")
    assert model.fixed == {"stiffness", "damping", "viscous_friction", "coulomb_friction"}
    model.save(tmp_path / "b.json")
    back = RobotModel.load(tmp_path / "b.json")
    assert (back.given, back.fixed) == ({"stiffness"}, model.fixed)
    np.testing.assert_array_equal(back.damping, model.damping)
    with pytest.raises(ModelError, match="fixed names 'weather'"):
        model.with_fixed("weather")
    (tmp_path / "b.json").write_text((tmp_path / "b.json").read_text().replace('"damping",', '"weather",'))
    with pytest.raises(ModelError, match="estimated may name stiffness"):
        RobotModel.load(tmp_path / "b.json")
    with pytest.raises(EffectError, match="no effect 'inertial_error'"):
        model.with_effect("inertial_error")


def test_a_saved_model_finds_its_urdf_from_another_folder(tmp_path: Path, monkeypatch) -> None:
    model = load_arm(tmp_path)
    (tmp_path / "deep" / "er").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    model.save("deep/er/b.json")
    assert json.loads((tmp_path / "deep/er/b.json").read_text())["robot"]["urdf"] == "../../two.urdf"
    monkeypatch.chdir(tmp_path / "deep")
    assert RobotModel.load("er/b.json").urdf.resolve() == (tmp_path / "two.urdf").resolve()


def test_save_leaves_nothing_half_written(tmp_path: Path) -> None:
    model = load_arm(tmp_path)
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(ModelError, match="cannot be written"):
        model.save(tmp_path / "missing" / "b.json")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ModelError, match="cannot be written"):
        model.save(tmp_path / "folder")
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*before, "folder"])
    assert list((tmp_path / "folder").iterdir()) == []


def test_an_effect_is_added_and_taken_away(tmp_path: Path) -> None:
    model = load_arm(tmp_path)
    richer = model.with_effect("coulomb_friction", joints=("elbow",))
    assert model.effects == () and richer.effects[0].values == {"torque": {"elbow": 0.0}}
    assert richer.without_effect("coulomb_friction").effects == ()
    with pytest.raises(ModelError, match="has no effect 'payload'"):
        richer.without_effect("payload")
    with pytest.raises(ModelError, match="listed twice"):
        richer.with_effect("coulomb_friction")
    with pytest.raises(EffectError, match="known effects: command_delay"):
        model.with_effect("magic")


def test_taking_an_effect_away_takes_its_intervals(tmp_path: Path) -> None:
    model = load_arm(tmp_path).with_effect("payload")
    model = model.with_(intervals={"payload.mass[tip]": (0.0, 1.0), "stiffness[elbow]": (1.0, 2.0)})
    assert set(model.without_effect("payload").intervals) == {"stiffness[elbow]"}


def test_the_table_of_parameters(tmp_path: Path) -> None:
    model = load_arm(tmp_path).with_effect(CoulombFriction(torque={"elbow": 0.2})).with_effect(Payload())
    model = model.with_(intervals={"coulomb_friction.torque[elbow]": (0.1, 0.3)})
    table = model.parameters()
    assert len(table) == 9 and [row.key.parameter for row in table][:2] == ["stiffness", "stiffness"]
    row = table["coulomb_friction.torque[elbow]"]
    assert (row.value, row.unit, row.off, row.interval, row.index) == (0.2, "N m", 0.0, (0.1, 0.3), 1)
    assert row.low == 0.0 and row.high == pytest.approx(6.0 * model.torque_scale[1])
    assert all(r.low <= r.value <= r.high for r in table)
    np.testing.assert_array_equal(table.select("stiffness", "damping").values, [60.0, 25.0, 5.0, 1.5])
    assert len(table.select("coulomb_friction")) == 1
    text = str(table)
    assert len(text.splitlines()) == 10 and "[0.1, 0.3]" in text
    assert max(len(line) for line in text.splitlines()) <= 120
    with pytest.raises(KeyError, match=r"stiffness\[shoulder\]"):
        table["stiffness[knee]"]


def test_units_follow_the_joint() -> None:
    units = {row.key.place: row.unit for row in robot("aloha").parameters().select("stiffness")}
    assert units["left_joint1"] == "N m/rad" and units["left_gripper"] == "N m/1"


def test_numbers_are_changed_by_name(tmp_path: Path) -> None:
    model = load_arm(tmp_path).with_effect("coulomb_friction")
    changed = model.with_values({"damping": {"elbow": 9.0}, "coulomb_friction.torque": {"elbow": 0.3}})
    np.testing.assert_array_equal(changed.damping, [5.0, 9.0])
    assert changed.effects[0].values["torque"] == {"shoulder": 0.0, "elbow": 0.3}
    np.testing.assert_array_equal(model.damping, [5.0, 1.5])


def test_a_model_is_frozen(tmp_path: Path) -> None:
    model = load_arm(tmp_path)
    with pytest.raises(ValueError, match="read-only"):
        model.stiffness[0] = 1.0
    with pytest.raises(AttributeError):
        model.name = "x"  # type: ignore[misc]


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_torque_scale_is_of_the_size_of_the_servo(name: str) -> None:
    """A limit or a friction is looked for in its multiples, so it may not be thousands of times smaller."""
    model = robot(name)
    ratio = model.torque_scale / (0.05 * model.stiffness)
    assert np.all(ratio > 0.003) and np.all(ratio < 300)
