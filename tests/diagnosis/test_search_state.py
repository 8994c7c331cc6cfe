"""What a search compares its errors with: other effects, other joints, and faultless robots."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.diagnosis.null_distribution import NullDistribution
from embodiedreamer_gym.diagnosis.search import _is_missed
from embodiedreamer_gym.diagnosis.search_state import SearchState
from embodiedreamer_gym.diagnosis.verdict import brings_little, unrefuted
from embodiedreamer_gym.diagnosis.wording import Attempt, verdict_text


def errors(*chi2: float) -> HeldOut:
    """Errors of joints whose noise is one."""
    values = np.array(chi2)
    return HeldOut(values, np.ones_like(values), np.tile(values, (4, 1)), np.ones((4, len(values)), int))


def null(largest: float, joints: int = 1) -> NullDistribution:
    """Faultless robots with chi2 up to a value."""
    chi2 = np.tile(np.linspace(0.5, largest, 100)[:, None], (1, joints))
    return NullDistribution(chi2, chi2, np.ones(joints, bool), 0)


def step(*held_out: float) -> Any:
    return SimpleNamespace(held_out=errors(*held_out), trained=errors(*held_out), kind=SimpleNamespace(name="friction"))


def start(by_effort: bool) -> Any:
    return None, SimpleNamespace(signals=SimpleNamespace(by_effort=by_effort)), None


@pytest.mark.parametrize(("without", "expected"), [(5.0, True), (4.2, False)])
def test_an_effect_is_missed_where_the_error_of_a_joint_rises_without_it(without, expected) -> None:
    state = SearchState(start(False), errors(9.0, 9.0), errors(9.0, 9.0), null(2.0, 2), [step(1.0, without)])
    assert _is_missed(state, step(1.0, 4.0)) is expected


def test_a_model_beyond_its_own_noise_is_refuted_by_one_that_is_not() -> None:
    right, wrong = step(1.1, 1.0), step(1.0, 7.0)
    most = null(1.5, 2).chi2
    assert unrefuted([wrong, right], most) == [right]
    assert unrefuted([wrong], most) == [wrong]


def test_the_certain_effect_of_a_pair_stands_apart_from_those_that_tie() -> None:
    state = SearchState(start(False), errors(9.0), errors(9.0), null(2.0))
    state.probabilities = {"friction": 1.0, "payload": 0.6, "base_tilt": 0.4}
    tie = ("payload", "base_tilt", "friction")
    text = verdict_text(Attempt("ambiguous", None, None, state, 0.001), tie, {"friction": ["elbow"]}, None)  # pyright: ignore[reportArgumentType]
    assert (
        text
        == "Missing: friction on elbow; and one of payload 0.60, base_tilt 0.40, which these recordings do not distinguish."
    )


def test_shares_are_of_robots_like_the_calibrated_model() -> None:
    """A fitted effect whose faultless robots would vary more than the error was large explains it all the same."""
    state = SearchState(start(False), errors(1000.0), errors(1000.0), null(2.0), closest=step(50.0))
    state.null = null(5000.0)
    text = verdict_text(Attempt("unknown", None, None, state, 0.001), (), {}, None)  # pyright: ignore[reportArgumentType]
    assert "the closest, friction, explains 95 %" in text


@pytest.mark.parametrize(
    ("most", "left", "steps", "expected"),
    [
        ([1.4, 8.0], None, 1, True),  # the null distribution judges, and nothing is fitted
        ([1.4, 900.0], [1.0, 9.0], 1, True),
        ([1.4, 900.0], [1.0, 11.0], 1, False),
        ([1.4, 900.0], [2.5, 1.0], 1, True),  # the law of a single effect may be inexact
        ([1.4, 900.0], [2.5, 1.0], 2, False),
    ],
)
def test_where_wrong_masses_make_large_errors_effects_are_judged_with_masses_estimated(
    most, left, steps, expected, monkeypatch
) -> None:
    module = sys.modules["embodiedreamer_gym.diagnosis.diagnose"]
    besides = [] if left is None else [SimpleNamespace(trained=errors(*left))]
    monkeypatch.setattr(module, "beside_robot_errors", lambda search, candidate: besides.pop())
    state: Any = SimpleNamespace(most=np.array(most), steps=[None] * steps)
    assert module._outlasts_masses(None, state) is expected
    assert not besides


@pytest.mark.parametrize(("before", "little"), [(1000.0, True), (3.0, False)])
def test_what_a_further_effect_brings_is_little_of_a_large_fall_only(before, little) -> None:
    assert brings_little(errors(before, before), errors(1.2, 1.0), errors(1.0, 1.0)) is little


@pytest.mark.parametrize(
    ("outlasts", "far", "expected"), [(True, False, True), (False, False, False), (False, True, True)]
)
def test_what_wrong_masses_swamp_is_judged_by_its_share_where_no_joint_is_near_its_noise(
    outlasts, far, expected, monkeypatch
) -> None:
    module = sys.modules["embodiedreamer_gym.diagnosis.diagnose"]
    monkeypatch.setattr(module, "_outlasts_masses", lambda search, state: outlasts)
    monkeypatch.setattr(module, "is_far_from_noise", lambda *errors: far)
    state = SearchState(start(False), errors(99.0), errors(99.0), null(1000.0), [step(9.0)])
    state.steps[0].judged = errors(9.0)
    assert state.is_exact
    assert module._fits_all_motion(None, state, None) is expected
