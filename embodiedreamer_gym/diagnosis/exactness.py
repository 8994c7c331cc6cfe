"""Further tests of whether effects are exact: a fit to all motion, and a fit with nuisance parameters of the robot."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, TOLERANCE, leave_valley
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState
from embodiedreamer_gym.diagnosis.verdict import EXACT, FAR, INEXACT
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem


def fit_together(search: Search, state: SearchState) -> None:
    """Fit the current model to all motion if its fit is exact on the training motion but not on the held-out motion.

    The training motion does not determine a limit that only the held-out motion reaches, although the law may be right.
    If a single effect is still not exact, nuisance parameters of the robot are estimated as well, see `_leaves_noise`.
    """
    state.together, state.exact_beside = None, False
    if state.steps and state.is_wrong_unseen:
        _fit_all_motion(search, state)
    if len(state.steps) == 1 and not state.by_effort and EXACT < state.excess <= FAR:
        state.exact_beside = _leaves_noise(search, state)


def _fit_all_motion(search: Search, state: SearchState) -> None:
    last = state.steps[-1]
    problem = Problem(last.model, [*search.train, *search.test], hold=last.problem.hold)
    fit = leave_valley(problem, minimise(problem, problem.start, ITERATIONS, TOLERANCE, derivatives=False))
    model = problem.model_at(fit.x)
    search.rollouts += 2 * problem.rollouts
    state.together = (evaluate(model, search.train, problem.hold), evaluate(model, search.test, problem.hold))


def _leaves_noise(search: Search, state: SearchState) -> bool:
    """Whether little more than noise is left on all motion if nuisance parameters are fitted to the training motion.

    Friction that grows with the load amplifies the error of wrong masses. If masses that are estimated on the training
    motion also lower the error on the held-out motion, they are the cause, and no second effect is needed.
    """
    last = state.steps[-1]
    problem, fit = fit_with_robot_errors(last.problem, last.fit.x, search.train, derivatives=False)
    held = evaluate(problem.model_at(fit.x), search.test, problem.hold)
    search.rollouts += problem.rollouts
    worst = np.maximum(problem.joint_rms(fit.residuals)[0] ** 2, held.chi2)
    return bool((worst <= np.minimum(EXACT * state.most, INEXACT)).all())
