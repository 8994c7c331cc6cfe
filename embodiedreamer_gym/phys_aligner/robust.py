"""A cost that is robust against outliers, and against a joint that no parameter can explain."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem

HUBER = 3.0  # multiple of the joint's rms above which a residual counts linearly
STRAY = 0.1  # largest share of a joint's samples that are treated as outliers


def huber_limit(problem: Problem, r: np.ndarray) -> np.ndarray:
    """Size (N,) above which a residual counts linearly: three rms of its joint, or of its bulk if there are outliers.

    There are outliers if at most one sample in ten exceeds six times the size of the bulk, and they triple the rms.
    """
    scale = np.maximum(problem.joint_rms(r)[0], 1.0)
    for j in range(len(scale)):
        size = np.abs(r[problem.joint_of == j])
        bulk = max(1.4826 * float(np.median(size)), 1.0) if len(size) else 1.0
        if scale[j] > 3.0 * bulk and np.mean(size > 6.0 * bulk) < STRAY:
            scale[j] = bulk
    return HUBER * scale[problem.joint_of]


def robust_cost(problem: Problem, r: np.ndarray, limit: np.ndarray) -> float:
    """Mean over joints of log(1 + mean Huber loss): r^2 inside the limit, linear outside."""
    size = np.abs(r)
    loss = np.where(size <= limit, r**2, limit * (2 * size - limit))
    return float(np.mean(np.log1p(problem.joint_mean(loss)[problem.joint_counts > 0])))


def robust_weight(problem: Problem, r: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Square root of each residual's weight (N,): Huber's, and one over its joint's size."""
    size = np.abs(r)
    loss = np.where(size <= limit, r**2, limit * (2 * size - limit))
    joint = 2.0 / (1.0 + problem.joint_mean(loss))
    return np.sqrt(np.minimum(1.0, limit / np.maximum(size, 1e-300)) * joint[problem.joint_of])
