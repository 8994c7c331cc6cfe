"""Errors of time stamps: the error of each stamp and their standard deviation, estimated from the log alone.

A stamp that is late by d shifts the position of every joint by -velocity * d at once, which no smooth motion does. Two
signals are used: the residual of the positions about a local cubic, and the deviation of the stamps from an even clock. A
regression of the first on the second gives the share of that deviation that is error; the rest is uneven sampling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.smoothing import smoothing_half

SIGNIFICANT = 4.0  # standard errors above which jitter is significant
LEAST = 0.1  # smallest share of the stamps' unevenness that counts as error
STRETCH = 0.25  # s; length of the segments whose scatter gives the standard errors
EVEN = 100  # stamps on either side to which an even clock is fitted
NEAR = 8  # stamps on either side used to distinguish a lost sample from a late stamp
USUAL = 0.003  # s, jitter for which the weights of the moments are optimal
WIDEST = 0.45  # largest error of a stamp, in sample periods


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Signals of one log.

    residual (T, n): positions minus the local cubic, and speed (T, n): the cubic's slope, both in units of the sensor
    noise; unevenness (T,): stamps minus an even clock, s; highpass (T, T): identity minus the cubic's smoothing matrix;
    period: median step, s; segment (T,): number of the segment of STRETCH seconds.
    """

    residual: np.ndarray
    speed: np.ndarray
    unevenness: np.ndarray
    highpass: csr_array
    period: float
    segment: np.ndarray

    def effect_of(self, delay: np.ndarray) -> np.ndarray:
        """Residual (T, n) caused by stamps that are late by `delay` (T,) s."""
        return -(self.highpass @ (self.speed * delay[:, None]))


def estimate_jitter(recording: Recording) -> float:
    """Standard deviation of a log's time stamps, s; 0 where none is significant.

    Needs two joints that move at the same time, or uneven stamps, and a motion that a cubic fits over 0.12 s.
    """
    return stamp_errors([recording])[0]


def stamp_errors(recordings: Sequence[Recording]) -> tuple[float, list[np.ndarray]]:
    """Standard deviation (s) of the stamp errors of logs with one clock, and the delay (T,) s of each stamp; 0 if none.

    The delays are conditional means: they are near 0 where the log has no evidence of a stamp's error.
    """
    logs = [_evidence(r) for r in recordings]
    trust = _share_of_unevenness(logs)
    residuals = [w.residual - w.effect_of(trust * w.unevenness) for w in logs]
    further = _common_variance(logs, residuals)
    unevenness = np.concatenate([w.unevenness for w in logs])
    delays = []
    for w, residual in zip(logs, residuals, strict=True):
        late = trust * w.unevenness + (_common_part(w, residual, further) if further > 0 else 0.0)
        delays.append(np.clip(late, -WIDEST * w.period, WIDEST * w.period))
    return float(np.sqrt(trust**2 * np.mean(unevenness**2) + further)), delays


def _evidence(recording: Recording) -> _Evidence:
    time, sigma = recording.time, np.maximum(recording.sigma, 1e-5)
    smooth, slope = _local_cubic(time, smoothing_half(recording))
    highpass = csr_array(eye_array(len(time)) - smooth)
    segment = ((time - time[0]) / STRETCH).astype(int)
    speed = slope @ (recording.position / sigma)
    period = float(np.median(np.diff(time)))
    return _Evidence(highpass @ (recording.position / sigma), speed, _unevenness(time), highpass, period, segment)


def _local_cubic(time: np.ndarray, half: int) -> tuple[csr_array, csr_array]:
    """Matrices (T, T) that give the value and slope of a cubic fitted to the neighbours at their own times."""
    count, width = len(time), min(2 * half + 1, len(time))
    columns = np.clip(np.arange(count) - half, 0, count - width)[:, None] + np.arange(width)
    scale = half * float(np.median(np.diff(time)))
    powers = ((time[columns] - time[:, None]) / scale)[..., None] ** np.arange(4)
    weights = np.linalg.pinv(powers)
    place = (np.repeat(np.arange(count), width), columns.ravel())
    value, slope = (csr_array((w.ravel(), place), shape=(count, count)) for w in (weights[:, 0], weights[:, 1] / scale))
    return value, slope


def _unevenness(time: np.ndarray) -> np.ndarray:
    """Delay (T,) s of each stamp relative to an even clock fitted to its neighbours; lost samples start a new fit."""
    usual, late = float(np.median(np.diff(time))), np.zeros(len(time))
    for part in np.split(np.arange(len(time)), _gaps(time, usual)):
        if len(part) > NEAR:
            late[part] = time[part] - _local_line(time[part])
    late[np.abs(late) < 1e-6 * usual] = 0.0
    return np.clip(late, -WIDEST * usual, WIDEST * usual)


def _gaps(time: np.ndarray, usual: float) -> np.ndarray:
    """Indices of samples that follow lost ones: all later stamps are late, unlike after a single late stamp."""
    late = np.pad(time - usual * np.arange(len(time)), NEAR, mode="reflect", reflect_type="odd")
    level = np.median(np.lib.stride_tricks.sliding_window_view(late, NEAR), axis=1)
    shift = level[NEAR:] - level[:-NEAR]  # level from this sample on, minus the level before it
    return np.flatnonzero((np.diff(time) > 1.4 * usual) & (shift[1 : len(time)] > 0.5 * usual)) + 1


def _local_line(x: np.ndarray) -> np.ndarray:
    """Value (k,), at each of the evenly spaced x (k,), of a line fitted to its neighbours."""
    count, width = len(x), min(2 * EVEN + 1, len(x))
    columns = np.clip(np.arange(count) - width // 2, 0, count - width)[:, None] + np.arange(width)
    place = np.arange(width) - (width - 1) / 2
    mean, slope = x[columns].mean(axis=1), x[columns] @ place / (place @ place)
    return mean + slope * (np.arange(count) - columns.mean(axis=1))


def _ratio(logs: Sequence[_Evidence], parts: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Ratio of two sums over samples, and its standard error from the scatter of segments; parts: terms of log i."""
    above, below = [], []
    for i, w in enumerate(logs):
        for sums, values in zip((above, below), parts(i), strict=True):
            sums.append(np.bincount(w.segment, values))
    top, bottom = np.concatenate(above), np.concatenate(below)
    total = float(bottom.sum())
    if total <= 0:
        return 0.0, np.inf
    ratio = float(top.sum()) / total
    return ratio, float(np.linalg.norm(top - ratio * bottom)) / total


def _share_of_unevenness(logs: Sequence[_Evidence]) -> float:
    """Share (0 .. 1) of the stamps' unevenness that is error, from a regression of the position residual on it."""

    def parts(i: int) -> tuple[np.ndarray, np.ndarray]:
        expected = logs[i].effect_of(logs[i].unevenness)
        weight = 1.0 / (1.0 + np.sum(expected**2, axis=1))
        return weight * np.sum(expected * logs[i].residual, axis=1), weight * np.sum(expected**2, axis=1)

    share, error = _ratio(logs, parts)
    return min(share, 1.0) if share > max(SIGNIFICANT * error, LEAST) else 0.0


def _common_variance(logs: Sequence[_Evidence], residuals: Sequence[np.ndarray]) -> float:
    """Variance of the stamp errors, s^2, from products of residuals (T, n) of different joints, whose noise differs."""

    def parts(i: int) -> tuple[np.ndarray, np.ndarray]:
        w = logs[i]
        along, power = w.speed * residuals[i], w.speed**2
        kept = np.asarray(w.highpass.multiply(w.highpass).sum(axis=1)).ravel()
        weight = 1.0 / (1.0 + USUAL**2 * power.sum(axis=1)) ** 2
        pairs = [x.sum(axis=1) ** 2 - np.sum(x**2, axis=1) for x in (along, power)]
        return weight * pairs[0], weight * kept * pairs[1]

    variance, error = _ratio(logs, parts)
    return variance if variance > SIGNIFICANT * error else 0.0


def _common_part(w: _Evidence, residual: np.ndarray, variance: float) -> np.ndarray:
    """Stamp errors (T,) s: their conditional mean, given a residual (T, n) and their variance."""
    matrix = diags_array(np.full(len(residual), 1.0 / variance)).tocsc()
    right = np.zeros(len(residual))
    for j in range(residual.shape[1]):
        bent = csr_array(w.highpass @ diags_array(w.speed[:, j]))
        matrix = matrix + (bent.T @ bent).tocsc()
        right -= bent.T @ residual[:, j]
    return np.asarray(spsolve(matrix, right))
