"""Sparse regression on a library of terms, by sequentially thresholded ridge regression (STLSQ).

Source: Brunton, Proctor and Kutz, PNAS 113, 2016 (SINDy), applied to the residual torques of the nominal model.
"""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.bench.entries import regression as r
from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task

ROUNDS = 10


def answer(task: Task) -> Finding:
    """Fit all terms, drop those with a share below 5 % of the torque, and fit again, until no term is dropped."""
    rest, columns = r.left_over(task, [*task.train, *task.test])
    chosen = np.ones((len(columns), rest.shape[1]), bool)
    coefficients = r.solve(rest, columns, chosen)
    for _ in range(ROUNDS):
        keep = chosen & (r.shares(columns, coefficients) >= r.VISIBLE)
        if np.array_equal(keep, chosen):
            break
        chosen, coefficients = keep, r.solve(rest, columns, keep)
    effects = r.effects_of(task, columns, coefficients)
    return Finding("missing" if effects else "nothing_missing", effects, r.predictions(task, columns, coefficients))
