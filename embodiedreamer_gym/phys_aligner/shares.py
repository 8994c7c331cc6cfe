"""Shares in a law, such as the jump at the edge of a dead zone: real laws often have a share of 0 or of 1.

A wide dead zone with some jump acts nearly like a narrower one without. Their likelihoods differ little along a long
valley with many small local minima, which derivatives do not show.
"""

from __future__ import annotations

import copy

import numpy as np

from embodiedreamer_gym.phys_aligner.least_squares import Fit, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.starts import best_by_joint, joint_of_rows
from embodiedreamer_gym.robot import ParameterKey

ITERATIONS, TOLERANCE = 6, 1e-4
REJECTED = 1.92  # fall of the log-likelihood above which a value is outside a 95 % interval
SIZES = np.geomspace(0.5, 2.0, 5)  # of the effect if a share is moved, relative to those of a fit


def share_rows(problem: Problem) -> np.ndarray:
    """Whether parameters (m,) are shapes between 0 and 1."""
    keys = {
        ParameterKey(p.name, e.name) for e in problem.model.effects for p in e.parameters
        if p.shape and (p.low, p.high, p.unit) == (0.0, 1.0, "1")
    }  # fmt: skip
    return np.array([row.key.group in keys for row in problem.rows], bool)


def at_bounds(problem: Problem, x: np.ndarray, shares: np.ndarray) -> list[np.ndarray]:
    """The parameters x (m,) with shares (m,) bool at 0 and at 1, each joint with the best size of the effect."""
    effects = {problem.rows[i].key.effect for i in np.flatnonzero(shares)}
    sizes = np.array([row.key.effect in effects for row in problem.rows]) & ~shares
    starts = []
    for bound in (problem.lower, problem.upper):
        moved = np.where(shares, bound, x)
        starts.append(best_by_joint(problem, [problem.times(moved, factor, sizes) for factor in SIZES]))
    return starts


def fits_at_bounds(problem: Problem, fit: Fit) -> np.ndarray:
    """Parameters (K, m) of fits with shares held at 0 and at 1, which the intervals have to contain.

    Joints where the likelihood of the residuals falls too much have the values of the original fit. K is 0 without
    shares.
    """
    shares = share_rows(problem)
    if not shares.any():
        return np.empty((0, len(fit.x)))
    log_chi2, count = np.log1p(problem.joint_rms(fit.residuals)[0] ** 2), problem.joint_counts
    found = []
    for start in at_bounds(problem, fit.x, shares):
        held = copy.copy(problem)
        held.lower, held.upper = (np.where(shares, start, bound) for bound in (problem.lower, problem.upper))
        other = minimise(held, start, ITERATIONS, TOLERANCE, derivatives=False)
        problem.rollouts = held.rollouts
        rise = np.log1p(problem.joint_rms(other.residuals)[0] ** 2) - log_chi2
        likely = rise * count * problem.independent <= REJECTED
        found.append(np.where(likely[joint_of_rows(problem)], other.x, fit.x))
    return np.stack(found)
