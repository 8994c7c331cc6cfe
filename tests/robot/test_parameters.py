"""Names of parameters, typed and as text."""

from __future__ import annotations

import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.parameters import ParameterKey, by_key, unit_at
from tests.bank import robot


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("stiffness", ParameterKey("stiffness")),
        ("stiffness[joint1]", ParameterKey("stiffness", place="joint1")),
        ("payload.mass", ParameterKey("mass", "payload")),
        ("payload.mass[left[0].tip]", ParameterKey("mass", "payload", "left[0].tip")),
    ],
)
def test_text_and_key_are_the_same(text: str, key: ParameterKey) -> None:
    assert ParameterKey.of(text) == key and str(key) == text and ParameterKey.of(key) is key
    assert str(key.group.at("x")) == f"{text.partition('[')[0]}[x]"


@pytest.mark.parametrize("text", ["", "a.b.c", "stiffness[]", "stiffness[a", "payload.", ".mass", "two words"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(ModelError, match="names no parameter"):
        by_key({text: 1.0})


def test_a_group_of_values_of_a_model() -> None:
    model = robot("aloha").with_effect("payload", ()).with_values({"payload.mass": {"left_gripper_tip": 0.2}})
    values = model.group_values(ParameterKey("mass", "payload"))
    assert values.tolist() == [0.2 if arm == "left_gripper_tip" else 0.0 for arm in model.arms]
    values[:] = 9.0
    assert model.group_values(ParameterKey("mass", "payload")).max() < 1.0, "a copy"
    for key in (ParameterKey("mass"), ParameterKey("weight", "payload"), ParameterKey("gap", "backlash")):
        with pytest.raises(ModelError, match="no parameter"):
            model.group_values(key)


@pytest.mark.parametrize(
    ("unit", "sliding", "normalised"),
    [
        ("N m/rad", "N/m", "N m/1"),
        ("N m s/rad", "N s/m", "N m s/1"),
        ("kg m^2", "kg", "kg m^2"),
        ("N m", "N", "N m"),
        ("N m s^2/rad^2", "N s^2/m^2", "N m s^2/1^2"),
        ("rad/(N m)", "m/N", "1/(N m)"),
        ("1/(N m)", "1/N", "1/(N m)"),
        ("rad/s", "m/s", "1/s"),
        ("s", "s", "s"),
    ],
)
def test_units_of_sliding_and_normalised_joints(unit: str, sliding: str, normalised: str) -> None:
    assert (unit_at(unit, "rad"), unit_at(unit, "m"), unit_at(unit, "1")) == (unit, sliding, normalised)
