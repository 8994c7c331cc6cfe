"""Starts of fits: pieces of the motion, out of the wrong valley."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.phys_aligner.least_squares import cost_of, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.starts import piecewise_start
from embodiedreamer_gym.recordings import pieces
from tests.two_joint_arm import load_arm, record


@pytest.fixture
def arm(tmp_path):
    return load_arm(tmp_path)


def test_pieces_are_the_recording_once(arm) -> None:
    log = record(arm, noise=1e-4)
    parts = pieces([log, log], 0.5)
    half = parts[: len(parts) // 2]
    assert len(half) == int(log.duration / 0.5)
    for name in ("time", "position", "command", "effort", "usable"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in half]), getattr(log, name))
    assert all(np.array_equal(part.sigma, log.sigma) for part in parts)


def test_pieces_of_a_slow_log_are_long_enough(arm) -> None:
    log = record(arm)
    slow = log.with_(**{k: getattr(log, k)[::10] for k in ("time", "position", "command", "effort", "usable")})
    assert min(part.time.size for part in pieces([slow], 0.5)) >= 16
    assert len(pieces([slow], 1000.0)) == 1


def test_a_start_by_pieces_is_nearer(arm) -> None:
    """From gains ten times too soft, and never worse than what was given."""
    problem = Problem(arm, [record(arm, noise=1e-4)])
    groups = np.array([str(row.key.group) for row in problem.rows])
    poor = problem.start - np.where(groups == "stiffness", np.log(10.0), 0.0)
    given = [cost_of(problem, x, problem.residuals(x)[0]) for x in (poor, problem.start)]
    spent = problem.rollouts
    found = piecewise_start(problem, [poor])
    assert cost_of(problem, found, problem.residuals(found)[0]) < 0.2 * given[0]
    assert problem.rollouts > spent + 2  # the pieces are counted
    best = piecewise_start(problem, [poor, problem.start])
    assert cost_of(problem, best, problem.residuals(best)[0]) <= min(given)


def test_a_fit_without_derivatives_ends_at_the_same_place_for_one_jacobian_less(arm) -> None:
    log = record(arm, noise=1e-4)
    found, spent = [], []
    for derivatives in (True, False):
        problem = Problem(arm, [log])
        found.append(minimise(problem, problem.start + 0.3, 3, 0.0, derivatives=derivatives))
        spent.append(problem.rollouts)
    assert np.array_equal(found[0].x, found[1].x) and np.allclose(found[0].residuals, found[1].residuals, atol=1e-9)
    assert found[1].cost == pytest.approx(found[0].cost)
    assert spent[0] - spent[1] == len(found[0].x) + 1


def test_derivatives_of_some_parameters_cost_only_those(arm) -> None:
    problem = Problem(arm, [record(arm, noise=1e-4)])
    only = np.arange(len(problem.start)) == 1
    whole, before = problem.jacobian(problem.start)[1], problem.rollouts
    part = problem.jacobian(problem.start, only=only)[1]
    assert np.allclose(part[:, 1], whole[:, 1]) and not part[:, ~only].any()
    assert problem.rollouts - before == 2
