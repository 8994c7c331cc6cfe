"""Where a fit begins: the best of a few sizes of each joint's gains, or of a few fits to short pieces of the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.least_squares import cost_of, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import pieces
from embodiedreamer_gym.robot import ParameterKey

PIECE = 0.5  # s: too short for a model that is far off to run away from the motion
ITERATIONS, TOLERANCE = 8, 1e-3


def scan_starts(problem: Problem) -> np.ndarray:
    """Pick for each joint the best of a few sizes of its servo's gains; returns scaled parameters (m,).

    Given gains are tried at 1/3, 1 and 3 times their value, unknown ones from 1/30 to 30 times the first guess.
    """
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
    best = np.argmin(rms, axis=0)  # joint by joint: the coupling between them is weaker than the wrong gain
    x = problem.start.copy()
    for i, row in enumerate(problem.rows):
        if stiff[i] or damped[i]:
            x[i] = points[best[row.index], i]
    return x


def piecewise_start(problem: Problem, starts: Sequence[np.ndarray]) -> np.ndarray:
    """Where to begin: the best on whole recordings of some scaled starts (m,) and of fits to pieces of the motion from them.

    A free run of seconds has a cost of many valleys where an effect is strong; runs of half a second, each begun at the
    measured state, have few. What a piece cannot show, as a slow fade, is lost in it, so that the starts themselves
    remain in the choice.
    Source: multiple shooting; Voss, Timmer and Kurths, Int. J. Bifurcation and Chaos 14(6), 2004.
    """
    if problem.signals.by_effort:  # no free run, no valleys
        return starts[0]
    short = Problem(problem.model, pieces(problem.recordings, PIECE), hold=problem.hold)
    ends, rival = [], np.inf
    for start in starts:
        fit = minimise(short, start, ITERATIONS, TOLERANCE, rival=rival)
        ends.append(fit.x)
        rival = min(rival, fit.cost)
    choices = np.stack([*starts, *ends])
    costs = [cost_of(problem, x, r) for x, r in zip(choices, problem.residuals(choices), strict=True)]
    problem.rollouts += short.rollouts
    return choices[int(np.argmin(costs))]
