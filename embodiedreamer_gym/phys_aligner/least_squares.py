"""Bounded Levenberg-Marquardt on free runs, robust to outliers and to a joint that no parameter can explain.

The cost is the mean over joints of log(1 + chi2 of the joint). This is the likelihood of residuals whose size is
unknown for each joint but never below the sensor's noise: a joint with an effect that the model lacks does not dominate
the others, and a joint that is nearly right is still improved. Errors of the URDF add the squares of their distance
from zero in standard deviations, as in the likelihood of their prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.problem import STEP, Problem
from embodiedreamer_gym.phys_aligner.robust import huber_limit, robust_cost, robust_weight

DAMPINGS = np.array([0.001, 0.03, 1.0])  # tried at once, relative to the current damping
LONGEST = 3.0  # largest step of a scaled parameter; one that is not a logarithm may also double
BEHIND = 0.1  # a fit is given up if its cost would stay above that of its rival by more than this


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a minimisation.

    x (m,): scaled parameters; cost: mean over joints of log(1 + chi2); residuals (N,), jacobian (N, m): in units of
    sensor noise; weight (N,): square root of each residual's weight; jumps (m,) bool: parameters whose derivatives
    depend on the step, because the law jumps; None if this was not tested.
    """

    x: np.ndarray
    cost: float
    residuals: np.ndarray
    jacobian: np.ndarray
    weight: np.ndarray
    converged: bool
    jumps: np.ndarray | None = None


def minimise(
    problem: Problem, start: np.ndarray, iterations: int = 30, tolerance: float = 1e-4, progress: ProgressCallback = silent,
    budget: float = np.inf, rival: float = np.inf, derivatives: bool = True, step: float = STEP,
) -> Fit:  # fmt: skip
    """Minimise a problem's cost inside its bounds from scaled parameters (m,).

    Each iteration uses one rollout per parameter (per pair, with two arms) for the Jacobian, and three for steps. It
    stops when the fall of the cost is below the tolerance, or when the next iteration would exceed `budget`, or when
    the cost is so far above that of a `rival` that the remaining iterations would not reach it at the current rate.
    derivatives: whether the Jacobian at the end is needed. Otherwise, and for a fit that a rival stopped, it is that of
    the last step.
    step: of the finite differences, in scaled units. If a law jumps, slopes over longer steps lead further: implicit
    filtering, Kelley, Implicit Filtering, SIAM, 2011.
    """
    x, damping = np.clip(start, problem.lower, problem.upper), 1e-2
    if not len(x):  # everything is fixed
        return fit_at(problem, x)
    r, jacobian = problem.jacobian(x, step)
    converged = False
    for iteration in range(iterations):
        limit = huber_limit(problem, r)
        cost = robust_cost(problem, r, limit) + problem.prior_cost(x)
        progress("least squares", iteration, iterations, error=f"{np.sqrt(np.expm1(cost)):.3g} sensor noises")
        weight = robust_weight(problem, r, limit)
        tried = _descend(problem, x, r, jacobian, weight, limit, cost, damping)
        if tried is None:
            converged = True
            break
        new, new_cost, damping, new_r = tried
        converged = cost - new_cost < tolerance or np.abs(new - x).max() < 1e-6
        hopeless = new_cost - (iterations - iteration - 1) * (cost - new_cost) > rival + BEHIND
        x, r, last = new, new_r, converged or hopeless or iteration == iterations - 1
        if not last or (derivatives and not hopeless):
            r, jacobian = problem.jacobian(x, step)
        if last or problem.rollouts + len(DAMPINGS) + len(x) + 1 > budget:
            break
    return _fit(problem, x, r, jacobian, converged)


def fit_at(problem: Problem, x: np.ndarray) -> Fit:
    """A fit that ended at scaled parameters (m,)."""
    return _fit(problem, x, *problem.jacobian(x), True)


def cost_of(problem: Problem, x: np.ndarray, r: np.ndarray) -> float:
    """Mean over joints of log(1 + chi2) of residuals (N,) at scaled parameters (m,), with less weight for outliers."""
    return robust_cost(problem, r, huber_limit(problem, r)) + problem.prior_cost(x)


def _fit(problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray, converged: bool) -> Fit:
    limit = huber_limit(problem, r)
    return Fit(
        x,
        robust_cost(problem, r, limit) + problem.prior_cost(x),
        r,
        jacobian,
        robust_weight(problem, r, limit),
        converged,
    )


def _descend(problem, x, r, jacobian, weight, limit, cost, damping):
    """The best of three damped steps: x, cost, damping, residuals; None if no damping up to a limit lowers the cost."""
    for _ in range(4):
        trials = np.stack([damped_step(problem, x, r, jacobian, weight, d * damping) for d in DAMPINGS])
        residuals = problem.residuals(trials)
        costs = [
            robust_cost(problem, row, limit) + problem.prior_cost(t) for row, t in zip(residuals, trials, strict=True)
        ]
        best = int(np.argmin(costs))
        if costs[best] < cost:
            return trials[best], costs[best], float(np.clip(damping * DAMPINGS[best], 1e-8, 1e8)), residuals[best]
        damping *= 100.0
    return None


def damped_step(
    problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray, w: np.ndarray, damping: float
) -> np.ndarray:  # fmt: skip
    """A damped Gauss-Newton step inside the bounds; parameters that would leave them are fixed there, pass by pass."""
    j, e = jacobian * w[:, None], r * w
    prior = 2.0 / problem.independent * problem.prior
    normal, gradient = j.T @ j + np.diag(prior), j.T @ e + prior * (x - problem.centre)
    diagonal = np.maximum(np.diag(normal), 1e-12 * max(np.diag(normal).max(), 1e-300))
    free = np.ones(len(x), bool)
    step = np.zeros(len(x))
    for _ in range(len(x)):
        index = np.flatnonzero(free)
        if not len(index):
            break
        a = normal[np.ix_(index, index)] + damping * np.diag(diagonal[index])
        rhs = gradient[index] + normal[np.ix_(index, ~free)] @ step[~free]
        step[index] = -np.linalg.solve(a + 1e-12 * np.trace(a) / len(a) * np.eye(len(a)), rhs)
        out = free & ((x + step < problem.lower) | (x + step > problem.upper))
        if not out.any():
            break
        step[out] = np.clip(x[out] + step[out], problem.lower[out], problem.upper[out]) - x[out]
        free &= ~out
    longest = LONGEST + np.where(problem.logarithmic, 0.0, np.abs(x))
    return np.clip(x + np.clip(step, -longest, longest), problem.lower, problem.upper)
