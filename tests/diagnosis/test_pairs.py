"""Pairs of effects in the linearised model, and where their refits begin."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

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
