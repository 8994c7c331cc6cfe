"""Names of parameters, typed and as text."""

from __future__ import annotations

import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.parameters import ParameterKey, by_key
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
