"""Other local minima of a fit: effects of half and of twice the size, with other dampings of the servo.

An overdamped servo and a low-pass of its command can exchange their time constants, and a wider dead zone that jumps at
its edge brakes like a narrower one. Such a fit ends near the noise, but with wrong values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, TOLERANCE, Candidate, as_candidate
from embodiedreamer_gym.diagnosis.limits import release_limits
from embodiedreamer_gym.diagnosis.refits import close_to_best
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState, added_effects
from embodiedreamer_gym.io.parallel import many
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.shares import at_bounds, share_rows
from embodiedreamer_gym.phys_aligner.starts import COARSE, best_by_joint
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey

SIZES = (0.5, 2.0)  # of the effects, relative to those of a fit
DAMPINGS = np.geomspace(0.25, 4.0, 7)  # of the servo, the same


def leave_valleys(search: Search, state: SearchState, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, with those close to the best also fitted from other sizes of their effects.

    Each joint keeps the better fit.
    """
    start, close = state.start[0], close_to_best(candidates)
    jobs = [(c, added_effects(start, c.model), search.train, search.test) for c in close]
    left = dict(zip(map(id, close), many(best_of_sizes, jobs, search.jobs), strict=True))
    search.rollouts += sum(left[id(c)].rollouts - c.rollouts for c in close)
    return [left.get(id(c), c) for c in candidates]


def best_of_sizes(
    candidate: Candidate, effects: Sequence[str], train: Sequence[Recording], test: Sequence[Recording]
) -> Candidate:  # fmt: skip
    """A candidate or, if better, its refit from a mixture: for each joint, the best of the fits from other sizes."""
    problem, x = candidate.problem, candidate.fit.x
    coarse = Problem(problem.model, train, hold=problem.hold, dt=COARSE)
    before = problem.rollouts
    ends = [
        minimise(coarse, start, ITERATIONS, TOLERANCE, derivatives=False).x for start in _starts(coarse, x, effects)
    ]
    mixed = best_by_joint(problem, [x, *ends])
    found = candidate
    if (mixed != x).any():
        fit = release_limits(problem, minimise(problem, mixed, ITERATIONS, TOLERANCE))
        if fit.cost < candidate.fit.cost:
            found = as_candidate(candidate.kind, problem, fit, test)
    return replace(found, rollouts=candidate.rollouts + problem.rollouts - before + coarse.rollouts)


def _starts(problem: Problem, x: np.ndarray, effects: Sequence[str]) -> list[np.ndarray]:
    """The parameters x (m,) with these effects at other sizes, and with their shares at 0 and at 1.

    Each joint has the best damping of the servo for each size, and the best size for each share.
    """
    sized = np.array([row.key.effect in effects for row in problem.rows])
    damped = np.array([row.key.group == ParameterKey("damping") for row in problem.rows])
    resized = [problem.times(x, size, sized) for size in SIZES]
    starts = [best_by_joint(problem, [problem.times(one, d, damped) for d in DAMPINGS]) for one in resized]
    shares = share_rows(problem) & sized
    return [*starts, *at_bounds(problem, x, shares)] if shares.any() else starts
