"""Frechet distance between two sets of features, each modelled as a Gaussian."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import VisionError


def frechet_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Squared Frechet distance of the Gaussians of features (n, D) and (m, D), in the features' units squared.

    |mean difference|^2 + tr(S1 + S2 - 2 (S1 S2)^(1/2)). With S = A'A, A the centred features over sqrt(n - 1), the
    last trace is the sum of singular values of A1 A2', so that no matrix square root is needed: the result stays exact
    if there are fewer samples than dimensions and the covariances are singular.
    Raises: VisionError for other shapes, fewer than two samples, or numbers that are not finite.
    Source: Dowson and Landau 1982, equation 4.
    """
    a, b = (_checked(x) for x in (first, second))
    if a.shape[1] != b.shape[1]:
        raise VisionError(f"features have {a.shape[1]} and {b.shape[1]} dimensions; the same network must make both.")
    means = a.mean(axis=0), b.mean(axis=0)
    factors = [(x - mean) / np.sqrt(len(x) - 1) for x, mean in zip((a, b), means, strict=True)]
    first, second = (_shortened(factor) for factor in factors)
    difference, common = means[0] - means[1], np.linalg.svd(first @ second.T, compute_uv=False).sum()
    value = difference @ difference + np.vdot(first, first) + np.vdot(second, second) - 2.0 * common
    return max(0.0, float(value))  # rounding may leave -1e-12


def _shortened(factor: np.ndarray) -> np.ndarray:
    """A factor of the same covariance with at most D rows."""
    return np.asarray(np.linalg.qr(factor, mode="r")) if len(factor) > factor.shape[1] else factor


def _checked(features: np.ndarray) -> np.ndarray:
    x = np.asarray(features, float)
    if x.ndim != 2 or len(x) < 2:
        raise VisionError(f"features of shape {x.shape} were given; (n, D) of at least two samples is expected.")
    if not np.isfinite(x).all():
        raise VisionError(f"{np.count_nonzero(~np.isfinite(x))} of {x.size} features are not finite; check the clips.")
    return x
