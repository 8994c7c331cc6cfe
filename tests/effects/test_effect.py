"""What an effect refuses, and how its values compare."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import Mechanics, Parameter
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.errors import EffectError


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"force": {"a": 1.0}}, "no parameter 'force'; it has torque"),
        ({"torque": 1.0}, "must map joint names to numbers"),
        ({"torque": {"a": float("nan")}}, "finite number"),
        ({"torque": {"a": True}}, "finite number"),
        ({"torque": {"a": "1"}}, "finite number"),
    ],
)
def test_bad_values_are_one_sentence(values, words: str) -> None:
    with pytest.raises(EffectError, match=words):
        CoulombFriction(**values)


def test_effects_are_equal_by_value() -> None:
    a, b = CoulombFriction(torque={"x": 0.1}), CoulombFriction(torque={"x": 0.1})
    assert a == b and hash(a) == hash(b) and a != CoulombFriction(torque={"x": 0.2}) and a != Payload()
    assert repr(a) == "CoulombFriction(torque[1])"
    assert CoulombFriction().values == {"torque": {}}, "what is not named is off"


def test_a_parameter_can_vanish_inside_its_bounds() -> None:
    with pytest.raises(EffectError, match=r"off value 2.0 is outside \[0.0, 1.0\]"):
        Parameter("x", "m", off=2.0, low=0.0, high=1.0, typical=0.5)


def test_a_point_mass_is_what_a_rigid_body_makes_of_it() -> None:
    body = Mechanics(
        mass=np.ones((2, 1)),
        first_moment=np.zeros((2, 1, 3)),
        inertia=np.zeros((2, 1, 3, 3)),
        gravity=np.zeros((2, 1, 3)),
        rotor_inertia=np.zeros((2, 1)),
        tip_body=np.zeros(1, int),
        tip_point=np.zeros((1, 3)),
    )
    body.add_point_mass(0, np.array([0.0, 2.0]), np.array([1.0, 2.0, 0.0]))
    np.testing.assert_allclose(body.mass, [[1.0], [3.0]])
    np.testing.assert_allclose(body.first_moment[1, 0], [2.0, 4.0, 0.0])
    np.testing.assert_allclose(body.inertia[1, 0], [[8, -4, 0], [-4, 2, 0], [0, 0, 10]])
    np.testing.assert_allclose(body.inertia[0], 0.0)
