from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from embodiedreamer_gym.phys_aligner.intervals import UNDETERMINED, autocovariance, correlation_lag, spread
from embodiedreamer_gym.recordings.rounded_noise import mean_rounding_error, rest_numbers

SAMPLES, JOINTS, UNKNOWNS = 300, 2, 4


def problem(samples: int = SAMPLES) -> Any:
    """What `spread` reads of a Problem with one recording."""
    return SimpleNamespace(
        lower=np.full(UNKNOWNS, -9.0),
        upper=np.full(UNKNOWNS, 9.0),
        recordings=(None,),
        model=SimpleNamespace(n=JOINTS),
        run_of=np.zeros(samples * JOINTS, int),
        joint_of=np.tile(np.arange(JOINTS), samples),
        prior=np.zeros(UNKNOWNS),
        independent=1.0,
        rounding=np.zeros((1, JOINTS)),
        rest_of=np.zeros(samples * JOINTS, int),
    )


def jacobian(rng: np.random.Generator, samples: int = SAMPLES) -> np.ndarray:
    """Smooth regressors, as of a motion."""
    white = rng.standard_normal((samples * JOINTS, UNKNOWNS)).reshape(samples, -1)
    return 30 * np.asarray(lfilter([0.1], [1, -0.9], white, axis=0)).reshape(samples * JOINTS, UNKNOWNS)


def ar1(rho: float, rng: np.random.Generator, samples: int = SAMPLES) -> np.ndarray:
    fresh = rng.standard_normal((samples, JOINTS))
    fresh[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], fresh, axis=0)).ravel()


@pytest.mark.parametrize("rho", [0.0, 0.8, 0.9])
def test_intervals_hold_the_truth_as_often_as_they_say(rho: float) -> None:
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(150):
        j, noise = jacobian(rng), ar1(rho, rng)
        x = -np.linalg.lstsq(j, noise, rcond=None)[0]
        inside.append(np.abs(x) <= spread(problem(), x, noise + j @ x, j).half_width)
    assert 0.91 <= np.mean(inside) <= 0.98


def test_what_a_coarse_encoder_rounds_at_rest_widens_the_intervals() -> None:
    """A friction that holds a joint off its command on one side or the other, at 30 rests of 40 samples."""
    rng, step, noise, rests, length = np.random.default_rng(8), 1.0, 0.25, 30, 40
    inside: dict[bool, list[bool]] = {True: [], False: []}
    column = np.repeat(np.tile([1.0, -1.0], rests // 2), length)
    for _ in range(150):
        angle = np.repeat(rng.uniform(0, 1, rests) + 5 * np.arange(rests), length)
        log = np.round((angle + noise * rng.standard_normal(len(angle))) / step) * step
        sigma = np.hypot(noise, step / np.sqrt(12))
        r, j = (log - angle) / sigma, np.zeros((len(angle), 1))
        j[:, 0] = column / sigma
        x = -np.linalg.lstsq(j, r, rcond=None)[0]
        for known in (True, False):
            one = problem(len(angle))
            one.model, one.joint_of, one.run_of = SimpleNamespace(n=1), *(np.zeros(len(angle), int),) * 2
            one.lower, one.upper, one.prior = np.full(1, -9.0), np.full(1, 9.0), np.zeros(1)
            one.rest_of = rest_numbers(log[:, None], np.full(1, step))[:, 0]
            one.rounding = mean_rounding_error(np.full(1, noise), np.full(1, step * known))[None] / sigma
            inside[known].append(bool(np.abs(x) <= spread(one, x, r + j @ x, j).half_width))
    assert np.mean(inside[False]) < 0.85 < 0.92 <= np.mean(inside[True]) <= 0.99


def test_the_mean_rounding_error_is_that_of_many_readings() -> None:
    rng, noise = np.random.default_rng(5), np.array([0.0, 0.2, 0.4])
    angle = rng.uniform(-50, 50, (400, 3))
    readings = np.round(angle + noise * rng.standard_normal((3000, 400, 3)))
    found = np.sqrt(np.mean((readings.mean(axis=0) - angle) ** 2, axis=0))
    np.testing.assert_allclose(found, mean_rounding_error(noise, np.ones(3)), rtol=0.08, atol=0.01)
    assert mean_rounding_error(np.ones(1), np.zeros(1)) == 0.0


def test_a_rest_ends_where_the_reading_has_moved_two_steps() -> None:
    x = np.array([[0, 1, 0, 1, 2, 2, 5, 6, 7.0]]).T
    assert rest_numbers(x, np.ones(1))[:, 0].tolist() == [0, 0, 0, 0, 4, 4, 6, 6, 8]
    assert rest_numbers(x, np.zeros(1))[:, 0].tolist() == list(range(9))


def test_residuals_that_follow_the_motion_widen_the_intervals() -> None:
    rng = np.random.default_rng(4)
    j = jacobian(rng)
    even = rng.standard_normal(len(j))
    bound_to_motion = even * np.abs(j[:, 0]) / np.sqrt(np.mean(j[:, 0] ** 2))
    x = np.zeros(UNKNOWNS)
    wide, narrow = (spread(problem(), x, e, j).half_width for e in (bound_to_motion, even))
    assert wide[0] > 1.3 * narrow[0]


def test_parameters_on_a_bound_or_without_effect_have_no_interval() -> None:
    rng = np.random.default_rng(5)
    j = jacobian(rng)
    j[:, 2] = 0.0
    x = np.array([0.0, 9.0, 0.0, 0.0])
    known = spread(problem(), x, ar1(0.0, rng), j)
    assert np.isinf(known.half_width).tolist() == [False, True, True, False]
    assert (known.half_width > UNDETERMINED).tolist() == [False, True, True, False]
    assert np.isnan(known.covariance[1]).all() and np.isfinite(known.covariance[0, 3])


def test_the_autocovariance_of_a_coloured_series() -> None:
    series = ar1(0.9, np.random.default_rng(6), 20_000)[::JOINTS]
    expected = 0.9 ** np.arange(30)
    assert np.abs(autocovariance(series)[:30] - expected).max() < 0.15
    white = np.random.default_rng(7).standard_normal(20_000)
    assert np.abs(autocovariance(white)[1:50]).max() < 0.05


@pytest.mark.parametrize("series", [np.zeros(40), np.ones(40), np.arange(5.0), np.array([1.0, -1.0, 1.0])])
def test_odd_series_have_a_finite_autocovariance(series: np.ndarray) -> None:
    assert np.all(np.isfinite(autocovariance(series)))
    assert 0 <= correlation_lag(series) <= len(series) / 4


def test_a_prior_is_the_interval_of_what_the_residuals_do_not_show() -> None:
    rng = np.random.default_rng(0)
    known, r = problem(), rng.standard_normal(SAMPLES * JOINTS)
    known.prior[0] = 1.0
    slopes = jacobian(rng)
    slopes[:, 0] *= 1e-4
    half = spread(known, np.zeros(UNKNOWNS), r, slopes).half_width
    assert half[0] == pytest.approx(1.96, rel=0.05)
    known.prior[0] = 0.0
    assert spread(known, np.zeros(UNKNOWNS), r, slopes).half_width[0] > 10
