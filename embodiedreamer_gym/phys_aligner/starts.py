"""Where a fit begins: the best of a few sizes of each joint's gains."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem


def scan_starts(problem: Problem) -> np.ndarray:
    """Pick for each joint the best of a few sizes of its servo's gains; returns scaled parameters (m,).

    Given gains are tried at 1/3, 1 and 3 times their value, unknown ones from 1/30 to 30 times the first guess.
    """
    groups = np.array([row.group for row in problem.rows])
    stiff, damped = groups == "stiffness", groups == "damping"
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
