"""Limits in a fit: scan those that the fit does not reach, and switch off those that the motion does not need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.effect_starts import Starts, fitted_values
from embodiedreamer_gym.diagnosis.largest_seen import largest_seen
from embodiedreamer_gym.effects import Parameter
from embodiedreamer_gym.phys_aligner.least_squares import Fit, cost_of, fit_at
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import ParameterKey, RobotModel

SCANNED = np.geomspace(0.4, 3.0, 16)  # sizes of a limit, relative to the largest value seen


def limit_starts(problem: Problem, x: np.ndarray, stuck: np.ndarray) -> Starts | None:
    """Starts at the parameters x (m,) of a fit, with each limit of its effects at many sizes; None without a limit.

    A limit that the fit does not reach does not change its cost, so no derivative leads to the right size.
    stuck (n,) bool: joints whose limits are changed; changes on the others would disturb them.
    """
    model = problem.model_at(x)
    fitted = fitted_values(model)
    tried = []
    for key, p in _limits(model).items():
        if key in fitted:
            top, bounds = largest_seen(p.unit, model, problem), model.parameter_bounds(p)
            sizes = [np.clip(factor * top, *bounds) for factor in SCANNED]
            tried += [{**fitted, key: np.where(stuck, size, fitted[key])} for size in sizes]
    return Starts((fitted, *tried)) if tried else None


def release_limits(problem: Problem, fit: Fit) -> Fit:
    """The fit with all limits switched off that it does not need, by the Akaike information criterion.

    The size of a limit that the motion does not reach is arbitrary, and faster motion might reach it.
    """
    limits = _limits(problem.model)
    rows = [i for i, row in enumerate(problem.rows) if row.key.group in limits and fit.x[i] < problem.upper[i] - 1e-9]
    if not rows:
        return fit
    alone = np.tile(fit.x, (len(rows), 1))
    alone[np.arange(len(rows)), rows] = problem.upper[rows]
    order = [rows[k] for k in np.argsort(_costs(problem, alone), kind="stable")]
    together = np.tile(fit.x, (len(order), 1))
    for k in range(len(order)):
        together[k, order[: k + 1]] = problem.upper[order[: k + 1]]
    rise = _costs(problem, together) - fit.cost
    needless = rise * problem.independent * len(problem.joint_of) <= np.arange(1, len(order) + 1)
    if not needless.any():
        return fit
    return replace(fit_at(problem, together[np.flatnonzero(needless)[-1]]), converged=fit.converged)


def _limits(model: RobotModel) -> dict[ParameterKey, Parameter]:
    """Limits of single joints among a model's effects."""
    return {
        ParameterKey(p.name, e.name): p for e in model.effects for p in e.parameters if p.is_limit and p.per == "joint"
    }


def _costs(problem: Problem, points: np.ndarray) -> np.ndarray:
    """Costs (K,) at scaled parameters (K, m)."""
    return np.array([cost_of(problem, x, r) for x, r in zip(points, problem.residuals(points), strict=True)])
