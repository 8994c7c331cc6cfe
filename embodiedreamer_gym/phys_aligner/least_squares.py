"""Bounded Levenberg-Marquardt on free runs, robust to outliers and to a joint that no parameter can explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem

HUBER = 3.0  # joint rms beyond which a residual counts linearly
DAMPINGS = np.array([0.03, 1.0, 30.0])  # tried at once, relative to the present damping
Progress = Callable[[str, int, float], None]


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a minimisation ended: scaled parameters (m,), cost (mean square residual), Jacobian (N, m), residuals."""

    x: np.ndarray
    cost: float
    jacobian: np.ndarray
    residuals: np.ndarray
    converged: bool


def minimise(
    problem: Problem, start: np.ndarray, iterations: int = 30, tolerance: float = 1e-4, progress: Progress | None = None,
    budget: int | None = None,
) -> Fit:  # fmt: skip
    """Minimise the mean Huber loss of a problem's residuals inside its bounds from scaled parameters (m,).

    Each iteration spends one rollout per parameter (per pair, with two arms) on the Jacobian and three on steps.
    Stops when the relative fall of the cost is below the tolerance, or when the next iteration would pass `budget`.
    """
    x, damping = np.clip(start, problem.lower, problem.upper), 1e-2
    r, jacobian = problem.jacobian(x)
    limit = HUBER * joint_scale(problem, r)[problem.joint_of]  # kept for the whole minimisation
    cost, converged = _cost(r, limit), False
    for iteration in range(iterations):
        if progress is not None:
            progress("least squares", iteration, cost)
        accepted = False
        for _ in range(4):
            trials = np.stack([_step(problem, x, r, jacobian, limit, d * damping) for d in DAMPINGS])
            residuals = problem.residuals(trials)
            costs = [_cost(row, limit) for row in residuals]
            best = int(np.argmin(costs))
            if costs[best] < cost:
                accepted = True
                break
            damping *= 100.0
        if not accepted:
            converged = True
            break
        fall = (cost - costs[best]) / max(cost, 1e-300)
        moved = np.abs(trials[best] - x).max()
        x, cost = trials[best], costs[best]
        damping = float(np.clip(damping * DAMPINGS[best], 1e-8, 1e8))
        converged = fall < tolerance or moved < 1e-6
        spent = budget is not None and problem.rollouts + len(x) + 4 > budget
        r, jacobian = problem.jacobian(x) if not spent else (residuals[best], jacobian)
        if converged or spent:
            break
    return Fit(x, cost, jacobian, r, converged)


def joint_scale(problem: Problem, r: np.ndarray) -> np.ndarray:
    """Robust size (n,) of the weighted residuals of each joint, never below the sensor's noise."""
    return np.maximum(problem.joint_rms(r)[0], 1.0) * problem.weight


def _cost(r: np.ndarray, limit: np.ndarray) -> float:
    """Mean Huber loss, r^2 inside the limit and linear outside."""
    size = np.abs(r)
    return float(np.mean(np.where(size <= limit, r**2, limit * (2 * size - limit))))


def _step(problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray, limit: np.ndarray, damping: float):
    """A damped Gauss-Newton step kept inside the bounds: parameters that would leave are fixed there, one pass each."""
    w = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(r), 1e-300)))
    j, e = jacobian * w[:, None], r * w
    normal, gradient = j.T @ j, j.T @ e
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
    return np.clip(x + np.clip(step, -3.0, 3.0), problem.lower, problem.upper)
