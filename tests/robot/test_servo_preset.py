"""Presets of servos: what a data sheet or a driver states, in a model's own units, and left alone by fits."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.files import ASSETS
from embodiedreamer_gym.robot.servo_preset import presets


def so101(folder, preset: str, **changes) -> RobotModel:
    data = json.loads((ASSETS / "so101.json").read_text())
    data["robot"]["urdf"] = "embodiedreamer:so101.urdf"
    data["servo"]["preset"] = preset
    path = folder / "arm.json"
    path.write_text(json.dumps(data | changes))
    return RobotModel.load(path)


@pytest.mark.parametrize("name", presets())
def test_a_preset_makes_a_model_that_survives_its_file(name: str, tmp_path) -> None:
    model = so101(tmp_path, name)
    assert model.effects or model.gravity_compensation.any()
    assert {effect.name for effect in model.effects} == model.fixed
    model.save(tmp_path / "b.json")
    back = RobotModel.load(tmp_path / "b.json")
    assert back.effects == model.effects and back.fixed == model.fixed
    np.testing.assert_array_equal(back.gravity_compensation, model.gravity_compensation)


def test_a_normalised_gripper_has_the_preset_in_its_own_unit(tmp_path) -> None:
    model = so101(tmp_path, "so101_lerobot")
    values = {effect.name: effect.values for effect in model.effects}
    stroke = 2.161736 + 0.174533
    assert values["profile"]["acceleration"]["shoulder_pan"] == 38.96
    assert values["profile"]["acceleration"]["gripper"] == pytest.approx(38.96 / stroke)
    assert values["torque_saturation"]["limit"] == {"gripper": pytest.approx(1.47 * stroke)}


def test_what_the_file_states_itself_stands_and_is_fitted(tmp_path) -> None:
    model = so101(tmp_path, "so101_lerobot", effects=[{"name": "profile", "acceleration": 20.0}])
    assert model.effects[0].values["acceleration"]["elbow_flex"] == 20.0
    assert "profile" not in model.fixed and "servo_deadzone" in model.fixed


def test_an_unknown_preset_is_one_sentence(tmp_path) -> None:
    with pytest.raises(ModelError, match=r"no servo.preset 'magic'; give one of .*ur_servoj"):
        so101(tmp_path, "magic")
