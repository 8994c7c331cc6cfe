"""Starts of fits: the best of a few sizes of each joint's gains, or of a few fits to short pieces of the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.effort_terms import joint_terms, start_values
from embodiedreamer_gym.phys_aligner.least_squares import cost_of, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.signals import effort_scale
from embodiedreamer_gym.recordings import pieces
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation import TIME_STEP

PIECE = 0.5  # s; too short for an inaccurate model to diverge from the motion
ITERATIONS, TOLERANCE = 8, 1e-3
COARSE = 2 * TIME_STEP  # s, time step of the plant in fits that only find a start


def scan_starts(problem: Problem) -> np.ndarray:
    """Pick for each joint the best of a few sizes of its servo's gains; returns scaled parameters (m,).

    Given gains are tried at 1/3, 1 and 3 times their value, unknown ones from 1/30 to 30 times the first guess. Fits to
    logs without commands start at plain least squares, see `_effort_start`.
    """
    if problem.signals.by_effort:
        return _effort_start(problem)
    groups = [row.key.group for row in problem.rows]
    stiff, damped = (np.array([g == ParameterKey(name) for g in groups]) for name in ("stiffness", "damping"))
    if not stiff.any() or not damped.any():
        return problem.start
    wide = "stiffness" not in problem.model.given
    factors = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if wide else (1 / 3, 1.0, 3.0)
    points = []
    for p in factors:
        for d in (0.3, 1.0, 3.0):
            x = problem.start.copy()
            x[stiff] += np.log(p)
            x[damped] += np.log(d * np.sqrt(p) if wide else d)
            points.append(x)
    points = np.clip(np.array(points), problem.lower, problem.upper)
    rms = problem.joint_rms(problem.residuals(points))
    best = np.argmin(rms, axis=0)  # per joint: the coupling between joints matters less than a wrong gain
    x = problem.start.copy()
    for i, row in enumerate(problem.rows):
        if stiff[i] or damped[i]:
            x[i] = points[best[row.index], i]
    return x


def _effort_start(problem: Problem) -> np.ndarray:
    """Rotor inertia and viscous friction by least squares of the effort, for joints where that fits better.

    Returns scaled parameters (m,).
    """
    model, signals = problem.model, problem.signals
    keys = (ParameterKey("rotor_inertia"), ParameterKey("viscous_friction"))
    groups = [row.key.group for row in problem.rows]
    scale, known = effort_scale(model), np.array([key not in groups for key in keys])
    if known[1]:
        return problem.start
    values = np.array([row.value for row in problem.rows])
    terms = joint_terms(model, problem.recordings, signals.measured, signals.usable)
    for i, row in enumerate(problem.rows):
        if row.key.group in keys:
            j = row.index
            found = start_values(*terms[j], scale[j], model.rotor_inertia[j] if known[0] else None)
            values[i] = np.clip(found[keys.index(row.key.group)], row.low, row.high)
    points = np.stack([problem.start, np.clip(problem.scale(values), problem.lower, problem.upper)])
    return best_by_joint(problem, points)


def piecewise_start(problem: Problem, starts: Sequence[np.ndarray]) -> np.ndarray:
    """Best start of a fit: joint by joint the best of some starts (m,) and of fits to pieces of the motion from them.

    If an effect is strong, the cost of a free run of seconds has many local minima. Runs of half a second, each started
    at the measured state, have few. Effects that a piece cannot show, such as a slow fade, are lost in it, so the
    starts themselves remain among the choices. The choice is made on whole recordings.
    Source: multiple shooting; Voss, Timmer and Kurths, Int. J. Bifurcation and Chaos 14(6), 2004.
    """
    if problem.signals.by_effort:  # without free runs there are no local minima
        return starts[0]
    short = Problem(problem.model, pieces(problem.recordings, PIECE), hold=problem.hold, dt=COARSE)
    ends, rival = [], np.inf
    for start in starts:
        fit = minimise(short, start, ITERATIONS, TOLERANCE, rival=rival, derivatives=False)
        ends.append(fit.x)
        rival = min(rival, fit.cost)
    points = np.stack([*starts, *ends])
    residuals = problem.residuals(points)
    mixed = recombine(problem, points, problem.joint_rms(residuals) ** 2)
    choices = np.stack([mixed, *points])
    residuals = np.concatenate([problem.residuals(mixed), residuals])
    costs = [cost_of(problem, x, r) for x, r in zip(choices, residuals, strict=True)]
    problem.rollouts += short.rollouts
    return choices[int(np.argmin(costs))]


def best_by_joint(problem: Problem, points: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Parameters (m,) with, for each joint, those of the point (m,) with the least error there, see `recombine`."""
    stacked = np.asarray(points)
    return recombine(problem, stacked, problem.joint_rms(problem.residuals(stacked)) ** 2)


def recombine(problem: Problem, points: np.ndarray, chi2: np.ndarray) -> np.ndarray:
    """Parameters (m,) with, for each joint, those of the point (K, m) with the least chi2 (K, n).

    If there are parameters of an arm, the point is chosen for the whole arm.
    """
    of_arm = any(row.key.place not in problem.model.joints for row in problem.rows)
    best, _ = best_choices(np.log1p(chi2)[:, None], (of_arm, False), problem.model)
    return points[best[joint_of_rows(problem)], np.arange(points.shape[1])]


def joint_of_rows(problem: Problem) -> np.ndarray:
    """Joint (m,) of each parameter; for a parameter of an arm, the arm's first joint."""
    model = problem.model
    return np.array([row.index if row.key.place in model.joints else int(np.flatnonzero(model.tree.arm == row.index)[0])
                     for row in problem.rows], int)  # fmt: skip


def best_choices(cost: np.ndarray, of_arm: Sequence[bool], model: RobotModel) -> tuple[np.ndarray, np.ndarray]:
    """Choices (n,) with the least cost (A, B, n) for each joint; an effect per arm has one choice on all its joints."""
    first, second = np.zeros(model.n, int), np.zeros(model.n, int)
    for a in range(model.tree.arms):
        own = np.flatnonzero(model.tree.arm == a)
        costs = cost[:, :, own]
        if of_arm[0] and of_arm[1]:
            first[own], second[own] = np.unravel_index(int(costs.sum(axis=2).argmin()), cost.shape[:2])
        elif of_arm[0]:
            first[own] = costs.min(axis=1).sum(axis=1).argmin()
            second[own] = costs[first[own[0]]].argmin(axis=0)
        elif of_arm[1]:
            second[own] = costs.min(axis=0).sum(axis=1).argmin()
            first[own] = costs[:, second[own[0]]].argmin(axis=0)
        else:
            first[own], second[own] = np.unravel_index(costs.reshape(-1, len(own)).argmin(axis=0), cost.shape[:2])
    return first, second
