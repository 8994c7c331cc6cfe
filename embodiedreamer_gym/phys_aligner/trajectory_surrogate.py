"""A linear surrogate of whole trajectories instead of single steps, which is corrected by every rollout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.least_squares import DAMPINGS, damped_step
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.robust import huber_limit, robust_cost, robust_weight
from embodiedreamer_gym.phys_aligner.starts import scan_starts

BUDGET = 150
LONGEST = 1.0  # scaled units, a factor e: longest step of the linear model
BLOCK_STEP = 0.05  # scaled units
POOR = 0.3  # fall of the cost (a logarithm) below which the model is computed again
NEAR = 0.3  # scaled units around the point where the model was computed, within which its optimum is accepted
RIDGE = 1e-3  # relative to a unit direction; keeps a correction by nearly parallel steps small


@dataclass(eq=False)
class _Model:
    """r(x) ~ residuals + jacobian (x - centre).

    complete: whether it was computed with a rollout per parameter; moved: distance that the centre has moved since.
    """

    centre: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    complete: bool
    moved: float = 0.0

    def correct(self, points: np.ndarray, residuals: np.ndarray) -> None:
        """Make the model exact at points (P, m) too: Broyden's update for several secants at once."""
        steps = points - self.centre
        size = np.maximum(np.linalg.norm(steps, axis=1), 1e-4)[:, None]
        miss = (residuals - self.residuals - steps @ self.jacobian.T) / size
        steps = steps / size
        update = np.linalg.solve(steps @ steps.T + RIDGE * np.eye(len(steps)), steps)
        self.jacobian = self.jacobian + miss.T @ update

    def move(self, points: np.ndarray, residuals: np.ndarray, best: int) -> None:
        """Use one of the points as the centre, and make the model exact at the others and at the old centre too."""
        others = np.arange(len(points)) != best
        points_passed = np.concatenate([self.centre[None], points[others]])
        residuals_passed = np.concatenate([self.residuals[None], residuals[others]])
        self.moved += float(np.abs(points[best] - self.centre).max())
        self.centre, self.residuals = points[best], residuals[best]
        self.correct(points_passed, residuals_passed)


def trajectory_surrogate(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback = silent, budget: int = BUDGET,
    iterations: int = 100, tolerance: float = 1e-4,
) -> np.ndarray:  # fmt: skip
    """Scaled parameters (m,) of the least-squares optimum, if `budget` rollouts suffice; rng is not used.

    The first model takes one rollout per kind of parameter, as if joints were uncoupled. Each round tries the model's
    damped minima, takes the best, and corrects the model by all of them. When this no longer helps, a model is computed
    from one rollout per parameter.
    Raises: CalibrationError for a budget below that of the scan of starts and the first model.
    Source: Broyden, Mathematics of Computation 19, 1965, for the correction.
    """
    x = scan_starts(problem)
    needed = problem.rollouts + len({row.key.group for row in problem.rows}) + 1 + len(DAMPINGS)
    if budget < needed:
        raise CalibrationError(f"the trajectory surrogate needs at least {needed} rollouts here, not {budget}.")
    model, damping = _block_model(problem, x), 1e-2
    for _ in range(iterations):
        if problem.rollouts + len(DAMPINGS) > budget:
            break
        limit = huber_limit(problem, model.residuals)
        before = robust_cost(problem, model.residuals, limit)
        progress(
            "trajectory surrogate", problem.rollouts, budget, error=f"{np.sqrt(np.expm1(before)):.3g} sensor noises"
        )
        points = np.stack([_descend(problem, model, limit, d * damping) for d in DAMPINGS])
        residuals = problem.residuals(points)
        costs = [robust_cost(problem, row, limit) for row in residuals]
        best = int(np.argmin(costs))
        gain = before - costs[best]
        if model.complete and abs(gain) < tolerance and model.moved < NEAR:
            return points[best] if gain > 0 else model.centre
        if gain > 0:
            damping = float(np.clip(damping * DAMPINGS[best], 1e-6, 1e6))
            model.move(points, residuals, best)
        else:
            damping *= 10.0
            model.correct(points, residuals)
        old = not model.complete or model.moved > NEAR
        if gain < POOR and old and problem.rollouts + len(x) + 1 + len(DAMPINGS) <= budget:
            model = _Model(model.centre, *problem.jacobian(model.centre), complete=True)
            damping = min(damping, 1e-2)
    return model.centre


def _descend(problem: Problem, model: _Model, limit: np.ndarray, damping: float) -> np.ndarray:
    """The model's damped minimum (m,) inside the bounds, at most LONGEST away in each parameter."""
    weight = robust_weight(problem, model.residuals, limit)
    minimum = damped_step(problem, model.centre, model.residuals, model.jacobian, weight, damping)
    return np.clip(minimum, model.centre - LONGEST, model.centre + LONGEST)


def _block_model(problem: Problem, x: np.ndarray) -> _Model:
    """A first model from one rollout per group, in which a parameter affects only its own joint (or arm)."""
    groups = list(dict.fromkeys(row.key.group for row in problem.rows))
    of = np.array([groups.index(row.key.group) for row in problem.rows])
    change = np.where(x + BLOCK_STEP <= problem.upper, BLOCK_STEP, -BLOCK_STEP)
    points = np.stack([x, *(np.where(of == g, x + change, x) for g in range(len(groups)))])
    residuals = problem.residuals(points)
    arm = problem.model.tree.arm[problem.joint_of]
    jacobian = np.zeros((residuals.shape[1], len(x)))
    for m, row in enumerate(problem.rows):
        per_joint = row.key.place in problem.model.joints
        own = problem.joint_of == row.index if per_joint else arm == problem.arm_of_row[m]
        jacobian[own, m] = (residuals[of[m] + 1] - residuals[0])[own] / change[m]
    return _Model(x, residuals[0], jacobian, complete=False)
