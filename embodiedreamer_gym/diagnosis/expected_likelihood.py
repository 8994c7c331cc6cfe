"""How clearly a motion decides between two models: the expected likelihood ratio of the right model to the wrong one.

One model is the ground truth and is simulated. The other model is refitted to it: servo gains (damping can imitate
viscous friction), the effect, and the URDF's errors with the prior of the null distribution. The difference that
remains counts, in units of sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear

from embodiedreamer_gym.diagnosis.candidate_motions import COMMAND_HZ, CandidateMotion, blank
from embodiedreamer_gym.diagnosis.null_distribution import CENTRE, GROUPS, MASS
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner.problem import CORRELATED, Problem, free_rows
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.data import UrdfError
from embodiedreamer_gym.simulation import simulate_sets

SETTLING = 2.0  # s at rest at the first command before a motion begins
LONGEST_STEP = 3.0  # scaled units, largest change of a parameter in one step
SHARES = (1.0, 0.5, 0.2, 0.05)  # shares of a step that are tried
ITERATIONS = 4
ENOUGH = 0.02  # relative fall of the cost below which a refit ends


def simulated(model: RobotModel, motions: Sequence[CandidateMotion], sigma: np.ndarray) -> list[Recording]:
    """Simulations of a model on motions, starting at rest at their first command; sigma (n,): sensor noise."""
    first, still = motions[0].command[:1], np.arange(0.0, SETTLING, 1 / COMMAND_HZ)
    pause = blank(model, "pause", still, np.repeat(first, len(still), axis=0), sigma)
    rest = simulate_sets(model, [pause])[0].position[0, -1:]
    logs = [blank(model, m.kind, m.time, m.command, sigma) for m in motions]
    runs = simulate_sets(model, [log.with_(position=np.repeat(rest, len(log.time), axis=0)) for log in logs])
    return [log.with_(position=run.position[0]) for log, run in zip(logs, runs, strict=True)]


def difference(one: Sequence[Recording], other: Sequence[Recording]) -> np.ndarray:
    """2 x difference of log-likelihood (K, n) between two models' runs of K motions, at each joint, without a refit."""
    squares = [np.sum(((a.position - b.position) / a.sigma) ** 2, axis=0) for a, b in zip(one, other, strict=True)]
    return np.array([independent(log) for log in one])[:, None] * squares


def after_one_step(truths: Sequence[Recording], other: RobotModel) -> np.ndarray:
    """Expected 2 x difference of log-likelihood (K, n) on each motion, after one linear refitting step of the other."""
    problem = _problem(other, truths)
    r, jacobian = problem.jacobian(problem.start)
    ratios = []
    for k, truth in enumerate(truths):
        rows, share = problem.run_of == k, independent(truth)
        step = _step(problem, problem.start, r[rows], jacobian[rows], share)
        left = r[rows] + jacobian[rows] @ step
        ratios.append(_by_joint(problem, problem.start + step, left, problem.joint_of[rows], share))
    return np.array(ratios)


def after_refit(truth: Recording, other: RobotModel) -> np.ndarray:
    """Expected 2 x difference of log-likelihood (n,) on one motion after refitting the other model to convergence."""
    problem, share = _problem(other, [truth]), independent(truth)
    x, ratios = problem.start, np.full(other.n, np.inf)
    for _ in range(ITERATIONS):
        r, jacobian = problem.jacobian(x)
        trials = np.vstack([x, x + np.outer(SHARES, _step(problem, x, r, jacobian, share))])
        residuals = [r, *problem.residuals(trials[1:])]
        costs = [_by_joint(problem, *trial, problem.joint_of, share) for trial in zip(trials, residuals, strict=True)]
        best = int(np.argmin(np.sum(costs, axis=1)))
        ratios, x = costs[best], trials[best]
        if ratios.sum() > (1 - ENOUGH) * costs[0].sum():
            break
    return ratios


def independent(log: Recording) -> float:
    """Share of a recording's samples that counts as independent."""
    return min(1.0, 1.0 / (log.hz * CORRELATED))


def _problem(model: RobotModel, logs: Sequence[Recording]) -> Problem:
    """The refit of a model: its own free parameters and the errors of the URDF."""
    groups = tuple(dict.fromkeys(row.key.group for row in free_rows(model)))
    if not model.has_effect(InertialError):
        model = model.with_(urdf_error=UrdfError(mass=MASS, centre=CENTRE)).with_effect(InertialError)
        groups += GROUPS
    return Problem(model, logs, groups, logs[0].command_hold)


def _by_joint(problem: Problem, x: np.ndarray, r: np.ndarray, joint_of: np.ndarray, share: float) -> np.ndarray:
    """Cost (n,) of residuals at scaled parameters (m,): each joint's own cost and an equal part of the prior's."""
    prior = float(np.sum(problem.prior * x**2))
    return share * np.bincount(joint_of, r**2, minlength=problem.model.n) + prior / problem.model.n


def _step(problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray, share: float) -> np.ndarray:
    """The Gauss-Newton step (m,) of the cost inside the bounds."""
    root = np.sqrt(problem.prior)
    rows = np.vstack([np.sqrt(share) * np.column_stack([jacobian, r]), np.column_stack([np.diag(root), root * x])])
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    low = np.maximum(problem.lower - x, -LONGEST_STEP) - 1e-9
    high = np.minimum(problem.upper - x, LONGEST_STEP) + 1e-9
    return lsq_linear(triangle[:, :-1], -triangle[:, -1], (low, high)).x
