"""A ladder of least squares: one more term for all joints, as long as it lowers the torque error on held-out recordings."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.bench.entries import regression as r
from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task

RUNGS = ((r.GAIN, r.VISCOUS), ("sign v",), ("1",), ("q",), ("v|v|",), (r.INERTIA,))
LOWER = 0.9  # of the error below, that a rung must not exceed


def answer(task: Task) -> Finding:
    """Gains and viscous friction, then dry friction, bias, spring, drag and inertia, each kept if it lowers the error by a tenth."""
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
