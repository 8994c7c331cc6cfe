"""95 % intervals that survive coloured residuals, and the parameters that a motion does not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.phys_aligner.problem import Problem

NORMAL_95 = 1.959963984540054
UNDETERMINED = 1.0  # half-width in scaled units: a factor e, or a typical size of the effect


@dataclass(frozen=True, eq=False)
class Spread:
    """Half-widths (m,) of the 95 % intervals in scaled units, covariance (m, m), and what is not determined."""

    half_width: np.ndarray
    covariance: np.ndarray
    undetermined: np.ndarray


def spread(problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray) -> Spread:
    """Sandwich covariance H^-1 S H^-1 with S from the autocovariance of the scores along each recording.

    The window is Bartlett's with a lag from the residuals' own correlation time (Newey and West, Econometrica 55,
    1987; lag rule after Andrews, Econometrica 59, 1991, AR(1) plug-in). Parameters on a bound are left out.
    """
    m = len(x)
    free = (x > problem.lower + 1e-9) & (x < problem.upper - 1e-9)
    sensitive = np.sum(jacobian**2, axis=0) > 1e-12 * max(np.sum(jacobian**2, axis=0).max(), 1e-300)
    keep = np.flatnonzero(free & sensitive)
    covariance = np.full((m, m), np.nan)
    half = np.full(m, np.inf)
    if len(keep):
        j = jacobian[:, keep]
        normal = j.T @ j
        size = np.sqrt(np.diag(normal))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
        cov = inverse @ _score_covariance(problem, r, j) @ inverse
        cov *= len(r) / max(len(r) - len(keep), 1)
        covariance[np.ix_(keep, keep)] = cov
        half[keep] = NORMAL_95 * np.sqrt(np.maximum(np.diag(cov), 0.0))
    return Spread(half, covariance, half > UNDETERMINED)


def _score_covariance(problem: Problem, r: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Long-run covariance (m, m) of the scores sum_t J_t r_t; joints and recordings do not see each other's time."""
    total = np.zeros((jacobian.shape[1],) * 2)
    for run in range(len(problem.recordings)):
        for joint in range(problem.model.n):
            rows = np.flatnonzero((problem.run_of == run) & (problem.joint_of == joint))
            if len(rows) < 3:
                continue
            e = r[rows]
            scores = jacobian[rows] * e[:, None]
            total += scores.T @ scores
            for lag in range(1, correlation_lag(e) + 1):
                weight = 1.0 - lag / (correlation_lag(e) + 1.0)
                cross = scores[lag:].T @ scores[:-lag]
                total += weight * (cross + cross.T)
    return total


def correlation_lag(e: np.ndarray) -> int:
    """Bandwidth for a series (T,): Andrews' AR(1) rule for the Bartlett window, at most a quarter of the series."""
    centred = e - e.mean()
    power = float(centred @ centred)
    if power <= 0:
        return 0
    rho = float(np.clip(centred[1:] @ centred[:-1] / power, -0.97, 0.97))
    alpha = 4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)
    return int(min(1.1447 * (alpha * len(e)) ** (1 / 3), len(e) / 4))
