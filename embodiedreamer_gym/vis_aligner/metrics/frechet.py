"""Frechet distance between two sets of features, each taken as a Gaussian."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import VisionError


def frechet_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Squared Frechet distance of the Gaussians of features (n, D) and (m, D), in the features' units squared.

    |mean difference|^2 + tr(S1 + S2 - 2 (S1 S2)^(1/2)). With S = A'A, A the centred features over sqrt(n - 1), the
    last trace is the sum of singular values of A1 A2', so that no matrix root is drawn: it stays exact where there
    are fewer samples than dimensions and the covariances are singular.
    Raises: VisionError for other shapes, fewer than two samples, or numbers that are not finite.
    Source: Dowson and Landau 1982, equation 4.
    """
    a, b = (_checked(x) for x in (first, second))
    if a.shape[1] != b.shape[1]:
        raise VisionError(f"features have {a.shape[1]} and {b.shape[1]} dimensions; the same network must make both.")
    means = a.mean(axis=0), b.mean(axis=0)
    factors = [(x - mean) / np.sqrt(len(x) - 1) for x, mean in zip((a, b), means, strict=True)]
    return _distance(means[0] - means[1], factors[0], factors[1])


def gaussian_distance(means: tuple[np.ndarray, np.ndarray], covariances: tuple[np.ndarray, np.ndarray]) -> float:
    """Squared Frechet distance of two Gaussians of means (D,) and covariances (D, D); see `frechet_distance`.

    Raises: VisionError for other shapes or numbers that are not finite.
    """
    (m1, m2), (s1, s2) = ([np.asarray(x, float) for x in pair] for pair in (means, covariances))
    if m1.ndim != 1 or m1.shape != m2.shape or s1.shape != s2.shape or s1.shape != (m1.size, m1.size):
        raise VisionError(
            f"means {m1.shape}, {m2.shape} and covariances {s1.shape}, {s2.shape} do not belong together."
        )
    if not all(np.isfinite(x).all() for x in (m1, m2, s1, s2)):
        raise VisionError("a mean or a covariance is not finite; check the features it came from.")
    return _distance(m1 - m2, _factor(s1), _factor(s2))


def _distance(difference: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    a, b = _shortened(a), _shortened(b)
    common = np.linalg.svd(a @ b.T, compute_uv=False).sum()
    value = difference @ difference + np.vdot(a, a) + np.vdot(b, b) - 2.0 * common
    return max(0.0, float(value))  # rounding may leave -1e-12


def _shortened(factor: np.ndarray) -> np.ndarray:
    """Factor of the same covariance with at most D rows."""
    return np.asarray(np.linalg.qr(factor, mode="r")) if len(factor) > factor.shape[1] else factor


def _factor(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def _checked(features: np.ndarray) -> np.ndarray:
    x = np.asarray(features, float)
    if x.ndim != 2 or len(x) < 2:
        raise VisionError(f"features of shape {x.shape} were given; (n, D) of at least two samples is expected.")
    if not np.isfinite(x).all():
        raise VisionError(f"{np.count_nonzero(~np.isfinite(x))} of {x.size} features are not finite; check the clips.")
    return x
