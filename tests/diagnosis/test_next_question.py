"""Every verdict but one that stands leads to two effects that the next motion has to distinguish."""

import pytest

from embodiedreamer_gym.diagnosis.next_question import next_question
from embodiedreamer_gym.effects import CATALOGUE

UNSEEN = ("backlash", "command_delay")


@pytest.mark.parametrize(
    ("verdict", "effects", "ranking", "asked", "pair"),
    [
        ("ambiguous", ("payload", "base_tilt"), (), ("backlash", "payload"), ("payload", "base_tilt")),
        ("missing", ("payload",), (), None, None),
        ("missing", ("servo_deadzone",), (), None, ("servo_deadzone", "backlash")),
        ("missing", ("servo_deadzone",), (), ("backlash", "servo_deadzone"), ("servo_deadzone", "backlash")),
        ("missing", ("payload",), (), ("backlash", "joint_elasticity"), ("backlash", "joint_elasticity")),
        ("nothing_missing", (), (), ("payload", "base_tilt"), ("payload", "base_tilt")),
        ("unknown", (), ("payload", "base_tilt", "backlash"), None, ("payload", "base_tilt")),
    ],
)
def test_what_is_asked_next(verdict, effects, ranking, asked, pair) -> None:
    assert next_question(verdict, effects, ranking, UNSEEN, CATALOGUE, asked) == pair


def test_nothing_missing_on_a_poor_motion_asks_for_the_likeliest_effect_that_it_cannot_show() -> None:
    first, second = next_question("nothing_missing", (), (), UNSEEN, CATALOGUE) or ("", "")
    assert first == "backlash" and second in CATALOGUE["backlash"].confused_with
    assert next_question("nothing_missing", (), (), (), CATALOGUE) is None
