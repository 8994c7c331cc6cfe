"""A pair of effects of which one alone suffices."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.candidates import Candidate, trained_errors
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.search import keep_one_if_enough
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState, current_null
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.io.progress import silent
from embodiedreamer_gym.phys_aligner.calibration import fit_least_squares
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from tests.two_joint_arm import load_arm, record

PAIR = ("coulomb_friction", "command_delay")
TRUE = {
    "coulomb_friction.torque": {"shoulder": 0.4, "elbow": 0.2},
    "command_delay.seconds": {"shoulder": 0.03, "elbow": 0.03},
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def found(arm, hidden: tuple[str, ...]) -> list[str]:
    """Effects that are left of both, fitted to an arm that has the hidden ones."""
    truth = arm
    for name in hidden:
        truth = truth.with_effect(CATALOGUE[name])
    truth = truth.with_values({key: v for key, v in TRUE.items() if key.split(".")[0] in hidden})
    train, test = [record(truth, noise=3e-4, seed=1)], [record(truth, name="wave_2", noise=3e-4, seed=2)]
    cache = RefitCache(None, arm, [*train, *test], CATALOGUE)
    search = Search(arm, train, test, CATALOGUE, 1, silent, False, np.random.default_rng(0), cache)
    problem, fit = fit_least_squares(arm, train)
    model = problem.model_at(fit.x)
    state = SearchState((model, problem, fit), evaluate(model, test), trained_errors(model, problem, fit), None)  # type: ignore[arg-type]
    both = model
    for name in PAIR:
        both = both.with_effect(CATALOGUE[name])
    both = Problem(both, train)
    end = minimise(both, both.start)
    kind, ended = CATALOGUE[PAIR[1]], both.model_at(end.x)
    state.steps = [Candidate(kind, ended, both, end, evaluate(ended, test), both.rollouts)] * 2
    state.null = current_null(search, state)
    keep_one_if_enough(search, state, [])
    return [e.name for e in state.steps[-1].model.effects]


@pytest.mark.parametrize("hidden", [PAIR[:1], pytest.param(PAIR[1:], marks=pytest.mark.release), PAIR])
def test_of_a_law_that_is_nearly_exact_only_a_second_effect_that_brings_much_is_kept(arm, hidden, monkeypatch) -> None:
    monkeypatch.setattr(SearchState, "is_exact", False)
    monkeypatch.setattr(SearchState, "excess", 1.8)
    assert found(arm, hidden) == list(hidden)
    monkeypatch.setattr(SearchState, "excess", 2.1)
    assert found(arm, hidden) == list(PAIR)


@pytest.mark.parametrize("hidden", [PAIR[:1], PAIR[1:], PAIR])
def test_what_is_kept_of_a_pair_is_what_the_arm_has(arm, hidden) -> None:
    assert found(arm, hidden) == list(hidden)
