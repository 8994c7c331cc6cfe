"""Pairs of effects in the linearised model, and where their refits begin."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import pair_search
from embodiedreamer_gym.diagnosis.pair_screening import screen_pairs
from embodiedreamer_gym.diagnosis.screening import LinearisationPoint, Screened
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.phys_aligner.starts import best_choices
from embodiedreamer_gym.robot import ParameterKey

N, JOINTS = 200, 2


def screened(name: str, change: np.ndarray) -> Screened:
    """An effect whose one size changes the residuals so."""
    sets = {ParameterKey(p.name, name): np.full((1, JOINTS), p.typical) for p in CATALOGUE[name].parameters}
    return Screened(CATALOGUE[name], 0.0, {}, 1.0, 1, sets=sets, change=change[None])


@pytest.fixture
def problem():
    tree = SimpleNamespace(arm=np.zeros(JOINTS, int), arms=1)
    model = SimpleNamespace(n=JOINTS, joints=("a", "b"), arms=("tip",), tree=tree)
    return SimpleNamespace(model=model, joint_of=np.repeat([0, 1], N), rows=())


def test_the_two_that_make_the_residual_come_first(problem) -> None:
    rng = np.random.default_rng(0)
    names = ("command_delay", "payload", "coulomb_friction", "torque_ripple", "rotor_inertia")
    changes = rng.standard_normal((len(names), JOINTS * N))
    residuals = -(6.0 * changes[1] / 6.0 + 0.8 * changes[3]) * 5.0 + 0.1 * rng.standard_normal(JOINTS * N)
    point = LinearisationPoint(problem.model, np.zeros(0), residuals, np.zeros((JOINTS * N, 0)))
    items = [screened(name, 5.0 * change) for name, change in zip(names, changes, strict=True)]
    pairs = screen_pairs(items, point, problem, np.ones(JOINTS), 3)
    assert {kind.name for kind in pairs[0].kinds} == {"payload", "torque_ripple"}
    assert pairs[0].score > pairs[1].score + 1.0


def test_a_law_and_its_special_case_are_no_pair(problem) -> None:
    rng = np.random.default_rng(0)
    changes = rng.standard_normal((2, JOINTS * N))
    point = LinearisationPoint(problem.model, np.zeros(0), changes.sum(axis=0), np.zeros((JOINTS * N, 0)))
    items = [screened(n, c) for n, c in zip(("coulomb_friction", "stribeck_friction"), changes, strict=True)]
    assert screen_pairs(items, point, problem, np.ones(JOINTS), 3) == []


def test_an_arms_effect_has_one_size_on_all_its_joints(problem) -> None:
    cost = np.ones((3, 2, JOINTS))
    cost[0, :, 0], cost[1, :, 1] = 0.1, 0.0  # each joint would like another size of the first
    cost[:, 1, 0] -= 0.05  # and the first joint the second size of the second
    one, other = best_choices(cost, (False, False), problem.model)
    assert one.tolist() == [0, 1] and other.tolist() == [1, 0]
    one, other = best_choices(cost, (True, False), problem.model)
    assert one.tolist() == [1, 1] and other.tolist() == [1, 0]


@pytest.fixture
def exchange(monkeypatch):
    """A function: cost of each pair of effects, worst chi2 -> pairs found from velocity_cascade with torque_ripple, and catalogues screened."""

    def model(names: frozenset[str]) -> Any:
        return SimpleNamespace(names=names, without_effect=lambda name: model(names - {name}))

    def candidate(names: frozenset[str], cost: float, chi2: float, found: str) -> Any:
        fit, trained = SimpleNamespace(cost=cost), SimpleNamespace(chi2=np.array([chi2]))
        problem, kind = SimpleNamespace(hold=None), SimpleNamespace(name=found)
        return SimpleNamespace(kind=kind, model=model(names), fit=fit, trained=trained, problem=problem)

    def run(costs: dict[frozenset[str], float], chi2: float) -> tuple[list[Any], list[set[str]]]:
        seen: list[set[str]] = []

        def screened(_search, problem, *rest, **_) -> list[Any]:
            seen.append(set(rest[3]))
            return [(problem.model.names, name) for name in rest[3]]

        def partners(_state, kept, _model, found, _nominal) -> list[Any]:
            pairs = [(frozenset({kept.name, name}), name) for _, name in found]
            return [Turn(pair, name) for pair, name in pairs if pair in costs]

        def refit(_search, trials, *_) -> list[Any]:
            return [candidate(t.pair, costs[t.pair], chi2, t.found) for t in trials]

        monkeypatch.setattr(pair_search, "added_effects", lambda _, m: sorted(m.names))
        monkeypatch.setattr(pair_search, "Problem", lambda m, *_, **__: SimpleNamespace(model=m, start=None))
        monkeypatch.setattr(pair_search, "fit_at", lambda *_: None)
        for name, replacement in (("screen_all", screened), ("_partners", partners), ("refit_all", refit)):
            monkeypatch.setattr(pair_search, name, replacement)
        search = SimpleNamespace(catalogue=CATALOGUE, train=())
        state = SimpleNamespace(start=(None, None, None), null=None)
        first = candidate(frozenset({"velocity_cascade", "torque_ripple"}), 1.1, chi2, "torque_ripple")
        return pair_search._exchange(search, state, [first], {}), seen  # type: ignore[arg-type]

    return run


@dataclass
class Turn:
    """A trial of two effects; found: the one that was sought beside the other."""

    pair: frozenset[str]
    found: str
    turn: int = 0


def test_both_effects_of_a_pair_are_exchanged_one_after_the_other(exchange) -> None:
    wanted = frozenset({"voltage_limit", "joint_spring"})
    costs = {frozenset({"voltage_limit", "torque_ripple"}): 0.95, wanted: 0.8}
    pairs, seen = exchange(costs, chi2=10.0)
    assert min(pairs, key=lambda c: c.fit.cost).model.names == wanted
    assert len(seen) == 4 and set(seen[0]) == set(
        CATALOGUE
    )  # two effects, then twice the one that the round before did not find, the last time without success


def test_a_pair_that_leaves_nothing_is_compared_with_similar_ones_alone(exchange) -> None:
    pairs, seen = exchange({frozenset({"velocity_cascade", "joint_spring"}): 1.1}, chi2=1.0)
    assert len(seen) == 2 and "joint_spring" in seen[0] and "payload" not in seen[0]
    assert len({c.model.names for c in pairs}) == len(pairs) == 2
