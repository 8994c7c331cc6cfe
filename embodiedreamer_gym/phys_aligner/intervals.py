"""95 % intervals that stay valid for autocorrelated residuals, and the parameters that a motion does not determine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz, toeplitz

from embodiedreamer_gym.phys_aligner.problem import Problem

NORMAL_95 = 1.959963984540054
HIGHEST_ORDER = 8  # of the autoregressive model of the residuals
HOPELESS = 50.0  # scaled units; a wider interval is treated as infinite
UNDETERMINED = 1.0  # half-width in scaled units: a factor e, or a typical size of the effect


@dataclass(frozen=True, eq=False)
class Spread:
    """Half-widths (m,) of the 95 % intervals in scaled units, and the covariance (m, m)."""

    half_width: np.ndarray
    covariance: np.ndarray


def spread(problem: Problem, x: np.ndarray, r: np.ndarray, jacobian: np.ndarray) -> Spread:
    """Sandwich covariance H^-1 S H^-1; S is the covariance of the scores J^T r along the recordings.

    There are two estimates of S, and each parameter gets the wider interval: J^T C J with the autocovariance C of
    an autoregressive model of each joint's residuals, which is exact for coloured noise that does not depend on the
    motion; and the autocovariance of the scores themselves (Newey and West, Econometrica 55, 1987), which also
    includes residuals that follow the motion, such as those of a missing effect. The prior of a parameter counts as one
    more observation. Parameters on a bound are left out.
    """
    m = len(x)
    free = (x > problem.lower + 1e-9) & (x < problem.upper - 1e-9)
    sensitive = np.sum(jacobian**2, axis=0) > 1e-12 * np.sum(jacobian**2, axis=0).max(initial=1e-300)
    keep = np.flatnonzero(free & sensitive)
    covariance = np.full((m, m), np.nan)
    half = np.full(m, np.inf)
    if len(keep):
        j = jacobian[:, keep]
        chi2 = float(np.mean(r**2))
        relative = (1.0 + chi2) / problem.independent  # of the prior to the residuals, as in the fit
        prior = relative * problem.prior[keep]
        normal = j.T @ j + np.diag(prior)
        size = np.sqrt(np.diag(normal))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True)
        inverse /= np.outer(size, size)
        count = len(r) / max(len(r) - len(keep), 1)
        cov = count * inverse @ coloured_covariance(problem, r, j) @ inverse
        own = count * inverse @ _score_covariance(problem, r, j) @ inverse
        wider = np.sqrt(np.maximum(np.diag(own) / np.maximum(np.diag(cov), 1e-300), 1.0))
        cov = cov * np.outer(wider, wider) + inverse @ np.diag(relative * prior) @ inverse
        covariance[np.ix_(keep, keep)] = cov
        half[keep] = NORMAL_95 * np.sqrt(np.maximum(np.diag(cov), 0.0))
        half[half > HOPELESS] = np.inf
    return Spread(half, covariance)


def _series(problem: Problem) -> Iterator[tuple[int, int, np.ndarray]]:
    """Recording, joint and rows of each residual series; correlations between joints or recordings are neglected."""
    for run in range(len(problem.recordings)):
        for joint in range(problem.model.n):
            rows = np.flatnonzero((problem.run_of == run) & (problem.joint_of == joint))
            if len(rows) >= 3:
                yield run, joint, rows


def coloured_covariance(problem: Problem, r: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of the scores if residuals are stationary, or constant while a joint with coarse encoder rests.

    For each joint in each recording, the larger one counts. An autoregressive model misses a small error that lasts as
    long as a rest, but such an error decides how well a friction or a weight is known.
    """
    total = np.zeros((jacobian.shape[1],) * 2)
    for run, joint, rows in _series(problem):
        own, e = jacobian[rows], r[rows]
        covariance = own.T @ matmul_toeplitz(autocovariance(e), own)
        same = min(float(problem.rounding[run, joint] ** 2), float(e @ e) / len(e))
        if same > 0:
            sums = np.add.reduceat(own, np.flatnonzero(np.diff(problem.rest_of[rows], prepend=-1)))
            white = own.T @ own
            resting = (float(e @ e) / len(e) - same) * white + same * sums.T @ sums
            size = np.maximum(np.diag(white), 1e-300)
            if np.sum(np.diag(resting) / size) > np.sum(np.diag(covariance) / size):
                covariance = resting
        total += covariance
    return total


def _score_covariance(problem: Problem, r: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of the scores from their own autocovariance, with Bartlett's window."""
    total = np.zeros((jacobian.shape[1],) * 2)
    for _, _, rows in _series(problem):
        lags = correlation_lag(r[rows])
        scores = jacobian[rows] * r[rows, None]
        total += scores.T @ scores
        for lag in range(1, lags + 1):
            cross = scores[lag:].T @ scores[:-lag]
            total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return total


def autocovariance(e: np.ndarray) -> np.ndarray:
    """Autocovariance (T,) of a series (T,) by an autoregressive model with its order by Schwarz's criterion (BIC)."""
    most = min(HIGHEST_ORDER, (len(e) - 1) // 4)
    autocovariance = np.array([e[k:] @ e[: len(e) - k] / len(e) for k in range(most + 1)])
    if autocovariance[0] <= 0:
        return np.zeros(len(e))
    models = []
    for order in range(most + 1):
        matrix = toeplitz(autocovariance[:order]) + 1e-9 * autocovariance[0] * np.eye(order)
        weights = np.linalg.solve(matrix, autocovariance[1 : order + 1])
        left = max(autocovariance[0] - weights @ autocovariance[1 : order + 1], 1e-12 * autocovariance[0])
        models.append((len(e) * np.log(left) + order * np.log(len(e)), order, weights))
    _, order, weights = min(models, key=lambda model: model[0])
    result = np.zeros(len(e))
    result[: order + 1] = autocovariance[: order + 1]
    for k in range(order + 1, len(e) if order else 0):
        result[k] = weights @ result[k - order : k][::-1]
    return result


def correlation_lag(e: np.ndarray) -> int:
    """Number of lags of a series (T,), at most T / 4 (Andrews, Econometrica 59, 1991, AR(1), Bartlett's window)."""
    centred = e - e.mean()
    power = float(centred @ centred)
    if power <= 0:
        return 0
    rho = float(np.clip(centred[1:] @ centred[:-1] / power, -0.97, 0.97))
    alpha = 4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)
    return int(min(1.1447 * (alpha * len(e)) ** (1 / 3), len(e) / 4))
