"""What a search compares its errors with: other effects, other joints, and faultless robots."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import search as search_module
from embodiedreamer_gym.diagnosis import search_state as search_state_module
from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.diagnosis.null_distribution import NullDistribution
from embodiedreamer_gym.diagnosis.search import _restore_joints
from embodiedreamer_gym.diagnosis.search_state import SearchState, _is_enough, likeliest
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


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("needed", "restored"), [({"b"}, ["b"]), ({"a", "b"}, ["b", "a"]), ({"a", "b", "c"}, None)])
def test_joints_come_back_one_at_a_time_until_none_is_missed(exact, needed, restored, monkeypatch) -> None:
    """The error of a joint that needs the effect is large without it, and most at joint b."""
    size, back = {"a": 30.0, "b": 50.0, "c": 20.0}, []

    def fit(joints: set[str]) -> Any:
        return step(*(size[j] if j in needed - joints else 1.0 for j in "abc"))

    def with_joint(pruned: Any, whole: Any, joint: str, train: object, test: object) -> Any:
        back.append(joint)
        return fit(set(back))

    monkeypatch.setattr(search_module, "removed_joints", lambda whole, pruned: set("abc") - set(back))
    monkeypatch.setattr(search_module, "with_joint", with_joint)
    model = SimpleNamespace(joints=("a", "b", "c"))
    state = SearchState(
        (model, *start(False)[1:]), errors(60.0, 60.0, 60.0), errors(60.0, 60.0, 60.0), null(2.0, 3), [fit(set())]
    )
    everywhere = [fit({"a", "b", "c"})]
    _restore_joints(SimpleNamespace(train=(), test=()), state, everywhere, exact)  # pyright: ignore[reportArgumentType]
    assert (state.steps is everywhere) is (restored is None)
    assert restored is None or back == restored


@pytest.mark.parametrize(("without", "missed"), [(5.0, True), (4.2, False)])
def test_a_joint_stays_out_where_the_error_hardly_rises(without, missed, monkeypatch) -> None:
    monkeypatch.setattr(search_module, "removed_joints", lambda whole, pruned: {"a"})
    monkeypatch.setattr(search_module, "fit_together", lambda search, state: None)
    model = SimpleNamespace(joints=("a", "b"))
    state = SearchState(
        (model, *start(False)[1:]), errors(9.0, 9.0), errors(9.0, 9.0), null(2.0, 2), [step(1.0, without)]
    )
    everywhere = [step(1.0, 4.0)]
    _restore_joints(SimpleNamespace(train=(), test=()), state, everywhere, exact=False)  # pyright: ignore[reportArgumentType]
    assert (state.steps is everywhere) is missed


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
    assert "The closest, friction, explains 95 % of the excess error." in text


@pytest.mark.parametrize(
    ("most", "left", "steps", "expected"),
    [
        ([1.4, 8.0], [], 1, True),  # the null distribution judges, and nothing is fitted
        ([1.4, 900.0], [[1.0, 9.0]], 1, True),
        ([1.4, 900.0], [[1.0, 11.0], [1.0, 11.0]], 1, False),
        ([1.4, 900.0], [[1.0, 11.0], [1.0, 9.0]], 1, True),  # after a few iterations more
        ([1.4, 900.0], [[2.5, 1.0]], 1, True),  # the law of a single effect may be inexact
        ([1.4, 900.0], [[2.5, 1.0], [2.5, 1.0]], 2, False),
    ],
)
def test_where_wrong_masses_make_large_errors_effects_are_judged_with_masses_estimated(
    most, left, steps, expected, monkeypatch
) -> None:
    module = sys.modules["embodiedreamer_gym.diagnosis.diagnose"]
    fits = [SimpleNamespace(x=None, residuals=np.sqrt(chi2)) for chi2 in left]
    problem = SimpleNamespace(rollouts=1, joint_rms=lambda residuals: residuals[None])
    monkeypatch.setattr(module, "fit_with_robot_errors", lambda *a, **k: (problem, fits.pop(0)))
    monkeypatch.setattr(module, "minimise", lambda *a, **k: fits.pop(0))
    last: Any = SimpleNamespace(problem=None, fit=SimpleNamespace(x=None))
    state: Any = SimpleNamespace(
        most=np.array(most),
        steps=[last] * steps,
        judged_start=errors(99.0, 99.0),
        judged=errors(1.0, 20.0),
        start_null=null(2.0, 2),
    )
    assert module._outlasts_masses(SimpleNamespace(train=(), rollouts=0), state) is expected
    assert not fits


@pytest.mark.parametrize(("left", "steps", "expected"), [(4.0, 1, True), (4.0, 2, False), (20.0, 1, False)])
def test_a_single_effect_that_explains_nearly_all_at_every_joint_needs_no_such_fit(
    left, steps, expected, monkeypatch
) -> None:
    module = sys.modules["embodiedreamer_gym.diagnosis.diagnose"]
    problem = SimpleNamespace(rollouts=1, joint_rms=lambda residuals: residuals[None])
    poor = problem, SimpleNamespace(x=None, residuals=np.array([50.0, 50.0]))
    monkeypatch.setattr(module, "fit_with_robot_errors", lambda *a, **k: poor)
    monkeypatch.setattr(module, "minimise", lambda *a, **k: poor[1])
    last: Any = SimpleNamespace(problem=None, fit=SimpleNamespace(x=None))
    state: Any = SimpleNamespace(
        most=np.array([1.4, 900.0]),
        steps=[last] * steps,
        judged_start=errors(1.0, 99.0),
        judged=errors(1.0, left),
        start_null=null(2.0, 2),
    )
    assert module._outlasts_masses(SimpleNamespace(train=(), rollouts=0), state) is expected


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
    state.steps[0].judged, state.start_null = errors(9.0), null(2.0)
    assert state.is_exact
    assert module._fits_all_motion(None, state, None) is expected


@pytest.mark.parametrize(("left", "together", "expected"), [(2.3, None, False), (1.2, None, True), (2.3, 1.2, True)])
def test_an_effect_that_explains_none_of_a_chance_alarm_is_not_named(left, together, expected, monkeypatch) -> None:
    """The second joint is little above what faultless robots have, and stays so, or falls in a fit to all motion."""
    module = sys.modules["embodiedreamer_gym.diagnosis.diagnose"]
    monkeypatch.setattr(module, "_outlasts_masses", lambda search, state: True)
    state = SearchState(start(False), errors(1.0, 2.3), errors(1.0, 1.0), null(2.0, 2), [step(1.0, left)])
    state.steps[0].trained, state.steps[0].judged = errors(1.0, 1.0), errors(1.0, left)
    state.together = None if together is None else (errors(1.0, 1.0), errors(1.0, together))
    assert state.is_exact
    assert module._fits_all_motion(None, state, None) is expected


@pytest.mark.parametrize(("together", "needed"), [(None, False), (1.1, True), (9.0, False)])
def test_a_recording_is_learned_from_only_where_a_fit_to_all_motion_is_what_makes_the_model_exact(
    together, needed
) -> None:
    state = SearchState(start(False), errors(99.0), errors(99.0), null(2.0), [step(9.0)])
    state.together = None if together is None else (errors(together), errors(together))
    assert state.needs_all_motion is needed


@pytest.mark.parametrize(
    ("before", "special", "richer", "enough"),
    [
        (1e4, 2.0, 1.5, True),  # a large error: its law may be nearly exact
        (1e4, 2.0, 1.0, False),  # the richer law brings more than 5 % of the fall
        (1e4, 4.5, 4.2, False),  # the special case leaves too much
        (20.0, 1.01, 1.0, True),
        (20.0, 1.1, 1.0, False),  # more than 1 % of the fall
    ],
)
def test_a_special_case_is_enough_if_the_richer_law_explains_hardly_more(before, special, richer, enough) -> None:
    plain, rich = (type(name, (), {"name": name, "generalises": ()}) for name in ("plain", "rich"))
    rich.generalises = ("plain",)

    def candidate(kind: type, chi2: float) -> Any:
        return SimpleNamespace(model=SimpleNamespace(effects=(kind(),)), judged=errors(chi2), **vars(step(chi2)))

    state = SearchState(start(False), errors(before), errors(before), null(2.0))
    one, other = candidate(plain, special), candidate(rich, richer)
    assert _is_enough(state, one, other) is enough
    assert not _is_enough(state, other, one) and not _is_enough(state, one, one)


@pytest.mark.parametrize(("special", "named"), [(2.0, "plain"), (9.0, "rich")])
def test_a_law_that_explains_hardly_more_is_not_compared_with_its_special_case(special, named, monkeypatch) -> None:
    plain, rich = (type(name, (), {"name": name, "generalises": ()}) for name in ("plain", "rich"))
    rich.generalises = ("plain",)

    def candidate(kind: type, chi2: float) -> Any:
        model = SimpleNamespace(effects=(kind(),))
        return SimpleNamespace(model=model, judged=errors(chi2), **vars(step(chi2)) | {"kind": kind})

    def most_to_the_last(base, before, candidates, *rest):  # the richer law is likelier
        return [0.01] * (len(candidates) - 1) + [1.0 - 0.01 * (len(candidates) - 1)]

    monkeypatch.setattr(search_state_module, "candidate_probabilities", most_to_the_last)
    nominal: Any = SimpleNamespace(has_effect=lambda kind: False)
    state = SearchState((nominal, *start(False)[1:]), errors(1e4), errors(1e4), null(2.0))
    search: Any = SimpleNamespace(train=(), test=(), rng=None, catalogue={"plain": plain, "rich": rich})
    best = likeliest(search, state, [candidate(plain, special), candidate(rich, 1.5)])
    assert best.kind.name == named and state.probabilities[named] > 0.95
