"""The Frechet distance against closed forms, also where covariances are singular."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import frechet_distance


def gaussian_distance(means: tuple[np.ndarray, np.ndarray], covariances: tuple[np.ndarray, np.ndarray]) -> float:
    """The distance of two Gaussians, from 2 D samples each that have exactly these means and covariances."""
    samples = []
    for mean, covariance in zip(means, covariances, strict=True):
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        factor = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * np.sqrt(len(mean) - 0.5)
        samples.append(np.concatenate([mean + factor, mean - factor]))
    return frechet_distance(*samples)


def test_diagonal_gaussians_have_a_closed_form() -> None:
    rng = np.random.default_rng(0)
    m1, m2 = rng.normal(size=(2, 12))
    s1, s2 = rng.uniform(0, 3, (2, 12))
    s1[:3] = 0.0  # singular
    expected = ((m1 - m2) ** 2).sum() + ((np.sqrt(s1) - np.sqrt(s2)) ** 2).sum()
    assert gaussian_distance((m1, m2), (np.diag(s1), np.diag(s2))) == pytest.approx(expected, rel=1e-12)


def test_samples_agree_with_the_matrix_root() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(200, 6)) @ rng.normal(size=(6, 6)), rng.normal(1, 2, (150, 6))
    s1, s2 = np.cov(a.T), np.cov(b.T)
    root = linalg.sqrtm(s1 @ s2).real
    expected = ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(s1 + s2 - 2 * root)
    assert frechet_distance(a, b) == pytest.approx(expected, rel=1e-9)
    assert gaussian_distance((a.mean(0), b.mean(0)), (s1, s2)) == pytest.approx(expected, rel=1e-9)


def test_it_is_a_distance_also_with_fewer_samples_than_dimensions() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 5, 400))
    assert frechet_distance(a, a) < 1e-9
    assert frechet_distance(a, b) == pytest.approx(frechet_distance(b, a), rel=1e-12)
    assert frechet_distance(a, a + 2.0) == pytest.approx(400 * 4.0, rel=1e-12)
    expected = gaussian_distance((a.mean(0), b.mean(0)), (np.cov(a.T), np.cov(b.T)))
    assert frechet_distance(a, b) == pytest.approx(expected, rel=1e-6)


def test_what_is_no_sample_is_refused() -> None:
    good, bad = np.ones((3, 2)), np.ones((3, 2))
    bad[1, 1] = np.nan
    for a, b, said in (
        (good[:1], good, "at least two samples"),
        (good, np.ones((3, 4)), "2 and 4 dimensions"),
        (good, bad, "1 of 6 features are not finite"),
    ):
        with pytest.raises(VisionError, match=said):
            frechet_distance(a, b)
