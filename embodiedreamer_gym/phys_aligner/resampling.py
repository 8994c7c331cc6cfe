"""Intervals of a parameter whose law jumps, by resampling: the error has no derivative, but it can be scanned."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem

POINTS = 81  # number of values that are tried
REACH = 1.0  # range of the scan: of a logarithm, else relative to the parameter or to its typical size if larger
BLOCK = 0.5  # s of motion that are drawn together
DRAWS = 2000


def with_jumps(problem: Problem, x: np.ndarray, half_width: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Distances (2, m) below and above a fit's scaled parameters x (m,) to the ends of their 95 % intervals.

    half_width (m,): half-widths from derivatives. For rows (m,) bool, whose law jumps, derivatives and resampling are
    added in squares; if derivatives determine nothing, resampling counts alone.
    """
    reach = np.repeat(half_width[None], 2, axis=0)
    if rows.any():
        resampled = resampled_reach(problem, x, rows)
        reach = np.where(np.isfinite(half_width) | ~rows, np.hypot(reach, resampled), resampled)
    return reach


def resampled_reach(problem: Problem, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The same distances by resampling alone; 0 except for rows (m,) bool.

    If a law jumps, the error as a function of its parameter is rugged, so that derivatives say nothing about how well
    it is determined. Each parameter is therefore scanned while the others are held, and blocks of the motion are drawn
    with replacement. The interval contains the value with the least error in 95 % of these draws (bootstrap; Kuensch,
    Annals of Statistics 17, 1989). A distance that reaches an end of the scan is infinite. Parameters of the same name
    are scanned on all joints at once, and each is judged by its own joint's residuals.
    """
    reach = np.zeros((2, len(x)))
    rng = np.random.default_rng(0)
    across = np.linspace(-1.0, 1.0, POINTS)
    wanted = [int(i) for i in np.flatnonzero(rows)]
    for group in dict.fromkeys(problem.rows[i].key.group for i in wanted):
        own = [i for i in wanted if problem.rows[i].key.group == group]
        points = np.repeat(x[None], POINTS, axis=0)
        for i in own:
            size = 1.0 if problem.logarithmic[i] else max(abs(x[i]), 1.0)
            points[:, i] = np.clip(x[i] + REACH * size * across * np.abs(across), problem.lower[i], problem.upper[i])
        squares = problem.residuals(points) ** 2
        for i in own:
            blocks = _blocks(problem, squares, i)
            drawn = blocks[rng.integers(0, len(blocks), (DRAWS, len(blocks)))].sum(axis=1)
            # if a limit is not reached, all values fit equally well: then the first counts below, and the last above
            first, last = drawn.argmin(axis=1), POINTS - 1 - drawn[:, ::-1].argmin(axis=1)
            low, high = np.quantile(points[first, i], 0.025), np.quantile(points[last, i], 0.975)
            ends = low <= problem.lower[i] or low > points[0, i], high >= problem.upper[i] or high < points[-1, i]
            reach[:, i] = max(x[i] - low, 0.0), max(high - x[i], 0.0)
            reach[~np.array(ends), i] = np.inf  # beyond the end of the scan, the error may fall further
    return reach


def _blocks(problem: Problem, squares: np.ndarray, row: int) -> np.ndarray:
    """Sums (blocks, P) of squares (P, N) over blocks of motion, for the joint or arm that a parameter acts on."""
    place = problem.rows[row].key.place
    joint = problem.joint_of
    if place in problem.model.joints:
        mine = joint == problem.model.joints.index(place)
    else:
        mine = problem.model.tree.arm[joint] == problem.arm_of_row[row]
    sums = []
    for run, recording in enumerate(problem.recordings):
        samples = np.flatnonzero(mine & (problem.run_of == run))
        if len(samples):
            pieces = np.array_split(samples, max(round(recording.duration / BLOCK), 1))
            sums += [squares[:, piece].sum(axis=1) for piece in pieces]
    return np.array(sums)
