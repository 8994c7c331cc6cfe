"""Stepwise least squares: terms are added for all joints if they lower the torque error on held-out recordings."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.bench.entries import regression as r
from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task

RUNGS = ((r.GAIN, r.VISCOUS), ("sign v",), ("1",), ("q",), ("v|v|",), (r.INERTIA,))
LOWER = 0.9  # multiple of the previous error that must be reached to keep a term


def answer(task: Task) -> Finding:
    """Fit gains and viscous friction, then add dry friction, bias, spring, drag and inertia.

    Each is kept if it lowers the error by at least 10 %.
    """
    rest, columns = r.left_over(task, task.train)
    held, seen = r.left_over(task, task.test)
    kept: tuple[str, ...] = ()
    best, error = np.zeros((len(columns), rest.shape[1])), np.inf
    for rung in RUNGS:
        chosen = np.array([[name in (*kept, *rung)] * rest.shape[1] for name in columns])
        coefficients = r.solve(rest, columns, chosen)
        now = float(np.sqrt(((held - r.explained(seen, coefficients)) ** 2).mean()))
        if not kept or now <= LOWER * error:
            kept, best, error = (*kept, *rung), coefficients, now
    effects = r.effects_of(task, columns, best)
    return Finding("missing" if effects else "nothing_missing", effects, r.predictions(task, columns, best))
