"""Bounded Levenberg-Marquardt on free runs, robust to outliers and to a joint that no parameter can explain.

The cost is the mean over joints of log(1 + chi2 of the joint), the likelihood of residuals whose size is unknown joint
by joint but never below the sensor's noise: a joint with an effect that the model lacks does not rule the others, and
a joint that is nearly right is still worth getting right. Errors of the URDF add the squares of their distance from zero
in standard deviations, as their prior's likelihood does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.problem import STEP, Problem
from embodiedreamer_gym.phys_aligner.robust import huber_limit, robust_cost, robust_weight

DAMPINGS = np.array([0.001, 0.03, 1.0])  # tried at once, relative to the present damping
LONGEST = 3.0  # step of a scaled parameter; one that is not a logarithm may double beside
BEHIND = 0.1  # cost by which a fit must fall short of its rival to be given up


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a minimisation ended.

    x (m,): scaled parameters; cost: mean over joints of log(1 + chi2); residuals (N,), jacobian (N, m): in sensor
    noises; weight (N,): square root of what each residual counts; jumps (m,) bool: parameters whose derivatives depend on the
    step, as where a law jumps; None where this was not looked at.
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

    Each iteration spends one rollout per parameter (per pair, with two arms) on the Jacobian and three on steps.
    Stops when the fall of the cost is below the tolerance, or when the next iteration would pass `budget`;
    and where it is so far above the cost of a `rival` that as many falls as iterations are left would not reach it.
    derivatives: whether the Jacobian at the end is needed. Without, and of a fit that a rival stopped, it is that of the last step.
    step: of the differences that stand for derivatives, in scaled units. Where a law jumps, slopes over longer steps lead further:
    implicit filtering, Kelley, Implicit Filtering, SIAM, 2011.
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
    """The fit that ended at scaled parameters (m,)."""
    return _fit(problem, x, *problem.jacobian(x), True)


def cost_of(problem: Problem, x: np.ndarray, r: np.ndarray) -> float:
    """Mean over joints of log(1 + chi2) of residuals (N,) at scaled parameters (m,), outliers counting less."""
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
    """The best of three damped steps, with larger damping until one descends: x, cost, damping, residuals; or None."""
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
    """A damped Gauss-Newton step kept inside the bounds: parameters that would leave are fixed there, one pass each."""
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
