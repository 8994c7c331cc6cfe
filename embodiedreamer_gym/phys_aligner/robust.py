"""From which size on a residual counts as an outlier."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem

HUBER = 3.0  # robust standard deviations of a joint beyond which a residual counts linearly
SHARE = 0.8  # of the residuals that set the size: blind to a fifth of outliers, yet sees a joint that moves seldom
NORMAL = 1.2815515655446004  # that quantile of the size of a standard normal number


def huber_limit(problem: Problem, r: np.ndarray) -> np.ndarray:
    """Limit (N,) of residuals (N,) beyond which they count linearly: by joint, never below that of the noise.

    A root mean square would not do: with 5 % of samples far off it grows until they are no outliers.
    """
    size = np.ones(problem.model.n)
    for joint in range(problem.model.n):
        own = np.abs(r[problem.joint_of == joint])
        if len(own):
            size[joint] = max(float(np.quantile(own, SHARE)) / NORMAL, 1.0)
    return HUBER * size[problem.joint_of]
