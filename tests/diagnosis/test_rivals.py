"""A pendulum whose drive saturates and whose viscous friction is not what the model says: what that does to the right effect."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import diagnose, null_distribution
from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.refits import beside_robot_errors, close_beside_robot_errors
from embodiedreamer_gym.diagnosis.verdict import EXACT
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.effects.torque_saturation import TorqueSaturation
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from tests.bank import fast, robot

LIMIT, NOISE = 0.45, 4e-4  # N m, rad


def play(model: RobotModel, seed: int) -> Recording:
    """The pendulum with 1.3 times its friction on quick sines, with noise."""
    truth = model.with_(viscous_friction=1.3 * model.viscous_friction)
    log = fast(truth, seed=seed, name=f"fast_{seed}")
    noise = NOISE * np.random.default_rng(seed).standard_normal(log.position.shape)
    return log.with_(position=simulate(truth, log).position + noise, noise=np.full(1, NOISE))


def fitted(model: RobotModel) -> tuple[Candidate, Any]:
    """A fit of the model to two logs, and the search that it is of."""
    problem, test = Problem(model, [play(model, seed) for seed in (1, 2)]), [play(model, 3)]
    fit = minimise(problem, problem.start)
    found = problem.model_at(fit.x)
    candidate = Candidate(TorqueSaturation, found, problem, fit, evaluate(found, test), problem.rollouts)
    return candidate, SimpleNamespace(train=problem.recordings, test=test, rollouts=0)


@pytest.fixture(scope="module")
def saturated() -> tuple[Candidate, Any]:
    limit = {"torque_saturation.limit": {"joint1": LIMIT}}
    return fitted(robot("pendulum1").with_effect("torque_saturation").with_values(limit))


def test_the_right_effect_leaves_nothing_with_the_robots_errors_beside(saturated) -> None:
    candidate, search = saturated
    judged = beside_robot_errors(search, candidate)
    assert candidate.judged.chi2[0] > 1.5 > 1.2 > judged.judged.chi2[0]
    assert judged.model is candidate.model and search.rollouts > 0


def test_a_richer_law_does_not_win_by_absorbing_wrong_friction(saturated) -> None:
    """A voltage limit imitates the friction that the model lacks, where the drive is at its limit."""
    search = saturated[1]
    catalogue = {name: CATALOGUE[name] for name in ("torque_saturation", "voltage_limit")}
    found = diagnose(robot("pendulum1"), search.train, search.test, catalogue=catalogue, jobs=1)
    assert found.verdict == "missing" and found.effects == ("torque_saturation",)


def test_only_candidates_close_behind_the_best_are_compared_beside_the_robots_errors(saturated) -> None:
    candidate, search = saturated
    close, far = (replace(candidate, fit=replace(candidate.fit, cost=candidate.fit.cost + d)) for d in (0.05, 1.0))
    assert close_beside_robot_errors(search, [far, candidate]) == [far, candidate]
    judged = close_beside_robot_errors(search, [far, candidate, close])
    assert judged[0] is far
    assert all(one.judged.chi2[0] < 1.2 < candidate.judged.chi2[0] for one in judged[1:])


def test_faultless_robots_with_a_drive_at_its_limit_have_wrong_friction(saturated, monkeypatch) -> None:
    candidate, search = saturated
    excess = []
    for viscous in (0.0, null_distribution.VISCOUS):
        monkeypatch.setattr(null_distribution, "VISCOUS", viscous)
        null = draw_null(candidate.model, candidate.fit, candidate.problem, search.test, np.random.default_rng(0))
        excess.append(null.excess(candidate.held_out.chi2, candidate.trained.chi2))
    assert excess[1] < min(EXACT, 0.8 * excess[0]), excess


def test_damping_makes_up_for_wrong_friction_where_no_drive_is_at_its_limit(monkeypatch) -> None:
    candidate, search = fitted(robot("pendulum1"))
    most = []
    for viscous in (0.0, null_distribution.VISCOUS):
        monkeypatch.setattr(null_distribution, "VISCOUS", viscous)
        null = draw_null(candidate.model, candidate.fit, candidate.problem, search.test, np.random.default_rng(0))
        most.append(np.quantile(null.chi2, 0.95))
    assert candidate.judged.chi2[0] < 1.2
    assert most[1] == pytest.approx(most[0], rel=0.1)
