"""Errors of time stamps: the error of each stamp and their standard deviation, estimated from the log alone.

A stamp that is late by d shifts the position of every joint by -velocity * d at once, which no smooth motion does. Two
signals are used: the residual of the positions about a local cubic, and the deviation of the stamps from an even clock. A
regression of the first on the second gives the share of that deviation that is error: samples may really be uneven.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.smoothing import smoothing_half

SIGNIFICANT = 4.0  # standard errors from which jitter counts
LEAST = 0.1  # share of the stamps' unevenness from which it counts as error
STRETCH = 0.25  # s; segments of a log whose scatter gives the standard errors
EVEN = 100  # stamps to either side to which an even clock is fitted
NEAR = 8  # stamps to either side that distinguish a lost sample from a late stamp
USUAL = 0.003  # s, jitter for which the weights of the moments are optimal
WIDEST = 0.45  # of a sample period, that a stamp may be off


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Signals of one log.

    residual, speed (T, n): of the positions about the local cubic, and the cubic's slope, in sensor noises; unevenness
    (T,): stamps minus an even clock, s; highpass (T, T): identity minus the cubic's smoothing; period: usual step, s;
    segment (T,): number of the stretch of STRETCH seconds.
    """

    residual: np.ndarray
    speed: np.ndarray
    unevenness: np.ndarray
    highpass: csr_array
    period: float
    segment: np.ndarray

    def effect_of(self, delay: np.ndarray) -> np.ndarray:
        """Residual (T, n) that stamps late by (T,) s cause."""
        return -(self.highpass @ (self.speed * delay[:, None]))


def estimate_jitter(recording: Recording) -> float:
    """Standard deviation of a log's time stamps, s; 0 where none is significant.

    Needs two joints that move at once, or uneven stamps; a motion that a cubic follows for 0.12 s.
    """
    return stamp_errors([recording])[0]


def stamp_errors(recordings: Sequence[Recording]) -> tuple[float, list[np.ndarray]]:
    """Standard deviation of the stamps of logs of one clock, s, and the delay (T,) s of each stamp; 0 where none.

    The delays are conditional means: near 0 where a log does not show a stamp's error.
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
    """Matrices (T, T) to the value and the slope of a cubic through the neighbours at their own times."""
    count, width = len(time), min(2 * half + 1, len(time))
    columns = np.clip(np.arange(count) - half, 0, count - width)[:, None] + np.arange(width)
    scale = half * float(np.median(np.diff(time)))
    powers = ((time[columns] - time[:, None]) / scale)[..., None] ** np.arange(4)
    weights = np.linalg.pinv(powers)
    place = (np.repeat(np.arange(count), width), columns.ravel())
    value, slope = (csr_array((w.ravel(), place), shape=(count, count)) for w in (weights[:, 0], weights[:, 1] / scale))
    return value, slope


def _unevenness(time: np.ndarray) -> np.ndarray:
    """Delay (T,) s of each stamp on an even clock fitted to its neighbours, fitted anew after lost samples."""
    usual, late = float(np.median(np.diff(time))), np.zeros(len(time))
    for part in np.split(np.arange(len(time)), _gaps(time, usual)):
        if len(part) > NEAR:
            late[part] = time[part] - _local_line(time[part])
    late[np.abs(late) < 1e-6 * usual] = 0.0
    return np.clip(late, -WIDEST * usual, WIDEST * usual)


def _gaps(time: np.ndarray, usual: float) -> np.ndarray:
    """Samples before which others are lost: then the stamps stay late, after a single late stamp they do not."""
    late = np.pad(time - usual * np.arange(len(time)), NEAR, mode="reflect", reflect_type="odd")
    level = np.median(np.lib.stride_tricks.sliding_window_view(late, NEAR), axis=1)
    shift = level[NEAR:] - level[:-NEAR]  # of a sample and those after it, from those before
    return np.flatnonzero((np.diff(time) > 1.4 * usual) & (shift[1 : len(time)] > 0.5 * usual)) + 1


def _local_line(x: np.ndarray) -> np.ndarray:
    """Values (k,) of a line through the neighbours of each of evenly spaced x (k,)."""
    count, width = len(x), min(2 * EVEN + 1, len(x))
    columns = np.clip(np.arange(count) - width // 2, 0, count - width)[:, None] + np.arange(width)
    place = np.arange(width) - (width - 1) / 2
    mean, slope = x[columns].mean(axis=1), x[columns] @ place / (place @ place)
    return mean + slope * (np.arange(count) - columns.mean(axis=1))


def _ratio(logs: Sequence[_Evidence], parts: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Ratio of two sums over samples, and its standard error by the scatter of the segments; parts: of log i, (T,) each."""
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
    """Share of the stamps' unevenness that is their error, 0 .. 1: by regression of the positions' residual on it."""

    def parts(i: int) -> tuple[np.ndarray, np.ndarray]:
        expected = logs[i].effect_of(logs[i].unevenness)
        weight = 1.0 / (1.0 + np.sum(expected**2, axis=1))
        return weight * np.sum(expected * logs[i].residual, axis=1), weight * np.sum(expected**2, axis=1)

    share, error = _ratio(logs, parts)
    return min(share, 1.0) if share > max(SIGNIFICANT * error, LEAST) else 0.0


def _common_variance(logs: Sequence[_Evidence], residuals: Sequence[np.ndarray]) -> float:
    """Variance of the stamps, s^2, from residuals (T, n): by products of different joints, whose noises differ."""

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
    """Errors (T,) s of the stamps, their conditional mean given a residual (T, n) and their variance."""
    matrix = diags_array(np.full(len(residual), 1.0 / variance)).tocsc()
    right = np.zeros(len(residual))
    for j in range(residual.shape[1]):
        bent = csr_array(w.highpass @ diags_array(w.speed[:, j]))
        matrix = matrix + (bent.T @ bent).tocsc()
        right -= bent.T @ residual[:, j]
    return np.asarray(spsolve(matrix, right))
