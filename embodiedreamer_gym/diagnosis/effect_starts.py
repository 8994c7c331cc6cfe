"""Where the refit of an effect begins: several sizes at nominal and at calibrated gains, the best of them joint by joint.

The cost of a free run has several valleys in the size of an effect; one rollout per size finds the deepest one's neighbourhood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import ParameterKey, RobotModel

SIZES = (0.15, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0)  # of a parameter that vanishes at zero, relative to its typical size
LIMITS = (0.6, 0.8, 1.0, 1.25, 1.6)  # of a limit, relative to the screening's
Values = Mapping[ParameterKey, np.ndarray]


def sizes_of(
    kind: type[Effect], model: RobotModel, start: Values, factors: Sequence[float] = (), both_signs: bool = True
) -> list[dict[ParameterKey, np.ndarray]]:
    """An effect's parameters at several sizes; shapes as in `start`, limits around it.

    factors: of the typical size, or of a limit in `start`; default: those of this module.
    both_signs: whether an effect with two directions is tried in both, else in that of `start`.
    """
    limit = any(p.off == p.high for p in kind.parameters)
    two = both_signs and any(p.low < 0 and not p.shape for p in kind.parameters)
    choices = []
    for factor in factors or (LIMITS if limit else SIZES):
        for sign in (1.0, -1.0) if two else (1.0,):
            values = {}
            for p in kind.parameters:
                key = ParameterKey(p.name, kind.name)
                low, high = model.parameter_bounds(p)
                typical = p.typical * high / p.high
                if p.shape:
                    values[key] = start[key]
                elif p.off == p.high:
                    values[key] = np.clip(factor * start[key], low, high)
                else:
                    own = 1.0 if p.low >= 0 else sign if both_signs else np.where(start[key] < 0, -1.0, 1.0)
                    values[key] = np.clip(own * factor * typical, low, high)
            choices.append(values)
    return choices


def start_of(problem: Problem, start: Values) -> np.ndarray:
    """Scaled start (m,) of a problem: the model's own values, but those of `start` (group -> values) where given."""
    low, high = np.array([row.low for row in problem.rows]), np.array([row.high for row in problem.rows])
    values = np.array([start[r.key.group][r.index] if r.key.group in start else r.value for r in problem.rows])
    return np.clip(problem.scale(np.clip(values, low, high)), problem.lower, problem.upper)


def best_by_joint(problem: Problem, starts: Sequence[np.ndarray]) -> np.ndarray:
    """Scaled start (m,) that takes for each joint, or arm, the best of several starts (m,); one rollout each.

    The coupling between joints is weaker than a wrong size. Parameters of an arm are chosen by the sum over its joints.
    """
    points = np.array(starts)
    return recombine(problem, points, problem.joint_rms(problem.residuals(points)) ** 2)


def recombine(problem: Problem, points: np.ndarray, chi2: np.ndarray) -> np.ndarray:
    """Parameters (m,) that take for each joint, or arm, those of the point (K, m) with the least chi2 (K, n) there."""
    tree = problem.model.tree
    by_arm = np.stack([np.log1p(chi2)[:, tree.arm == a].sum(axis=1) for a in range(tree.arms)], axis=1).argmin(axis=0)
    of_arm = [row.key.place in problem.model.arms and row.key.place not in problem.model.joints for row in problem.rows]
    best = by_arm[tree.arm] if any(of_arm) else chi2.argmin(axis=0)
    chosen = [by_arm[a] if arm else best[row.index]
              for row, arm, a in zip(problem.rows, of_arm, problem.arm_of_row, strict=True)]  # fmt: skip
    return points[np.array(chosen), np.arange(points.shape[1])]
