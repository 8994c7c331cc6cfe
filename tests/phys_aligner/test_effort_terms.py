"""Least squares of an effort on the terms that every driven joint has."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects.effort_sensor import later
from embodiedreamer_gym.phys_aligner.effort_terms import effort_per_torque, start_values


def terms_of(weight: float) -> np.ndarray:
    """Torque of the bodies, acceleration, speed and its sign (N, 4) of a swing, about their means."""
    t = np.linspace(0, 20, 4000)
    q = np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    table = np.stack([weight * np.sin(q + 1.0) - 0.5 * weight * v * np.abs(np.cos(q)), a, v, np.sign(v)], axis=1)
    return table - table.mean(axis=0)


@pytest.mark.parametrize("true", [0.2, -0.2])
def test_the_scale_of_a_joint_that_rubs_more_than_it_weighs(true) -> None:
    """Torque alone gives a scale that is far off; friction gives the sign, and the terms together the size."""
    terms = terms_of(5.0)
    effort = true * (terms @ [1.2, 0.1, 5.0, 4.0]) + 0.05 * np.random.default_rng(0).standard_normal(len(terms))
    alone = float(terms[:, 0] @ effort / (terms[:, 0] @ terms[:, 0]))
    scale = effort_per_torque(effort, terms, 9.0)
    assert scale == pytest.approx(1.2 * true, rel=0.05)
    assert abs(alone - 1.2 * true) > 0.5 * abs(true)
    rotor, viscous = start_values(effort, terms, 1.2 * true, None)
    assert (rotor, viscous) == pytest.approx((0.1 / 1.2, 5.0 / 1.2), rel=0.1)


def test_a_joint_without_weight_gets_the_sign_and_a_plausible_size() -> None:
    terms = terms_of(0.0)
    effort = -0.2 * (terms @ [1.0, 0.1, 2.0, 4.0])
    scale = effort_per_torque(effort, terms, 9.0)
    assert -0.2 * 5 < scale < -0.2 / 5


def test_an_effort_is_delayed_by_any_number_of_samples() -> None:
    t = np.arange(200.0)
    signal = np.sin(0.05 * t)[None, :, None]
    for samples in (2.0, 2.5, -1.25):
        late = later(signal, np.full((1, 1, 1), samples))[0, 5:-5, 0]
        assert late == pytest.approx(np.sin(0.05 * (t[5:-5] - samples)), abs=1e-3)
