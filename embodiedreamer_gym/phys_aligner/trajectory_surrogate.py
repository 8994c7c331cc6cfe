"""A surrogate of whole trajectories instead of single steps: linear, corrected by every rollout, cheap to descend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.calibration import scan_starts
from embodiedreamer_gym.phys_aligner.least_squares import DAMPINGS, HUBER, Progress, _cost, _step, joint_scale
from embodiedreamer_gym.phys_aligner.problem import Problem

BUDGET = 150
LONGEST = 1.0  # scaled units, a factor e: farther the linear model is not believed
BLOCK_STEP = 0.05  # scaled units
POOR = 0.3  # relative fall of the cost below which the model is learnt anew
NEAR = 0.3  # scaled units moved since the model was learnt, within which its verdict "no better point" is believed
RIDGE = 1e-3  # of a unit direction; keeps a correction by nearly parallel steps small


@dataclass(eq=False)
class _Model:
    """r(x) ~ residuals + jacobian (x - centre); complete: learnt from one rollout per parameter; moved since then."""

    centre: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    complete: bool
    moved: float = 0.0

    @property
    def fresh(self) -> bool:
        return self.moved == 0.0

    def correct(self, points: np.ndarray, residuals: np.ndarray) -> None:
        """Make the model pass through rollouts at points (P, m): Broyden's update for several secants at once."""
        steps = points - self.centre
        size = np.maximum(np.linalg.norm(steps, axis=1), 1e-4)[:, None]
        miss = (residuals - self.residuals - steps @ self.jacobian.T) / size
        steps = steps / size
        self.jacobian = self.jacobian + miss.T @ np.linalg.solve(steps @ steps.T + RIDGE * np.eye(len(steps)), steps)


def trajectory_surrogate(
    problem: Problem, rng: np.random.Generator, progress: Progress | None = None, budget: int = BUDGET,
    iterations: int = 100, tolerance: float = 1e-4,
) -> np.ndarray:  # fmt: skip
    """Scaled parameters (m,) of the least-squares optimum, mostly within `budget` rollouts; rng is not used.

    The first model takes one rollout per kind of parameter, as if joints did not feel each other. Each round tries
    the model's damped minima, takes the best, and corrects the model by all of them; where that no longer helps, a
    model with one rollout per parameter is learnt. Raises: CalibrationError for a budget below the first model's.
    Source: Broyden, Mathematics of Computation 19, 1965.
    """
    x = scan_starts(problem)
    needed = problem.rollouts + len({row.group for row in problem.rows}) + 1 + len(DAMPINGS)
    if budget < needed:
        raise CalibrationError(f"the trajectory surrogate needs a budget of at least {needed} rollouts, not {budget}.")
    model = _block_model(problem, x)
    limit = HUBER * joint_scale(problem, model.residuals)[problem.joint_of]
    damping = 1e-2
    for iteration in range(iterations):
        if problem.rollouts + len(DAMPINGS) > budget:
            break
        before = _cost(model.residuals, limit)
        if progress is not None:
            progress("trajectory surrogate", iteration, before)
        points = np.stack([_descend(problem, model, limit, d * damping) for d in DAMPINGS])
        residuals = problem.residuals(points)
        costs = [_cost(row, limit) for row in residuals]
        best = int(np.argmin(costs))
        gain = (before - costs[best]) / max(before, 1e-300)
        if model.complete and abs(gain) < tolerance and model.moved < NEAR:
            return points[best] if gain > 0 else model.centre
        if gain > 0:
            damping = float(np.clip(damping * DAMPINGS[best], 1e-6, 1e6))
            _move(model, points, residuals, best)
            limit = np.minimum(limit, HUBER * joint_scale(problem, model.residuals)[problem.joint_of])
        else:
            damping *= 10.0
            model.correct(points, residuals)
        stale = not model.complete or model.moved > NEAR
        if gain < POOR and stale and problem.rollouts + len(x) + 1 + len(DAMPINGS) <= budget:
            model = _Model(model.centre, *problem.jacobian(model.centre), complete=True)
            damping = min(damping, 1e-2)
    return model.centre


def _descend(problem: Problem, model: _Model, limit: np.ndarray, damping: float) -> np.ndarray:
    """The model's damped minimum inside the bounds, at most LONGEST away in each parameter."""
    there = _step(problem, model.centre, model.residuals, model.jacobian, limit, damping)
    return np.clip(there, model.centre - LONGEST, model.centre + LONGEST)


def _move(model: _Model, points: np.ndarray, residuals: np.ndarray, best: int) -> None:
    """Centre the model on one of the points and correct it by the others and by the old centre."""
    others = np.arange(len(points)) != best
    known = np.concatenate([model.centre[None], points[others]])
    seen = np.concatenate([model.residuals[None], residuals[others]])
    model.moved += float(np.abs(points[best] - model.centre).max())
    model.centre, model.residuals = points[best], residuals[best]
    model.correct(known, seen)


def _block_model(problem: Problem, x: np.ndarray) -> _Model:
    """A first model from one rollout per group, in which a parameter moves its own joint (or arm) alone."""
    groups = list(dict.fromkeys(row.group for row in problem.rows))
    of = np.array([groups.index(row.group) for row in problem.rows])
    change = np.where(x + BLOCK_STEP <= problem.upper, BLOCK_STEP, -BLOCK_STEP)
    points = np.stack([x, *(np.where(of == g, x + change, x) for g in range(len(groups)))])
    residuals = problem.residuals(points)
    arm = problem.model.tree.arm[problem.joint_of]
    jacobian = np.zeros((residuals.shape[1], len(x)))
    for m, row in enumerate(problem.rows):
        own = problem.joint_of == row.index if row.joint in problem.model.joints else arm == problem.arm_of_row[m]
        jacobian[own, m] = (residuals[of[m] + 1] - residuals[0])[own] / change[m]
    return _Model(x, residuals[0], jacobian, complete=False)
