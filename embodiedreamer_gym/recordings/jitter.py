"""Time stamps that are off: how far each is, and their standard deviation, from the log alone.

A stamp that is late by d shifts the position of every joint by -velocity * d at once, which no smooth motion does. Two
witnesses are heard: the part of the positions that a local cubic does not follow, and the unevenness of the stamps. What
the second is worth, the first says: stamps may be uneven because the samples were.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.smoothing import smoothing_half

SURE = 4.0  # standard errors from which jitter is believed
LEAST = 0.1  # share of the stamps' unevenness, the like
STRETCH = 0.25  # s; pieces of a log whose scatter gives the standard errors
EVEN = 100  # stamps to either side through which an even clock is drawn
NEAR = 8  # stamps to either side that tell a lost sample from a late stamp
USUAL = 0.003  # s, jitter for which the moments are weighted best
WIDEST = 0.45  # of a sample period, that a stamp may be off


@dataclass(frozen=True, eq=False)
class _Witness:
    """What a log says: positions' rest (T, n) and speed (T, n) in sensor noises, stamps' unevenness (T,) s, and I - S."""

    rest: np.ndarray
    speed: np.ndarray
    uneven: np.ndarray
    highpass: csr_array
    period: float
    piece: np.ndarray

    def seen(self, delay: np.ndarray) -> np.ndarray:
        """What stamps late by (T,) s leave in the positions' rest (T, n)."""
        return -(self.highpass @ (self.speed * delay[:, None]))


def estimate_jitter(recording: Recording) -> float:
    """Standard deviation of a log's time stamps, s; 0 where none is plain.

    Needs two joints that move at once, or uneven stamps; a motion that a cubic follows for 0.12 s.
    """
    return stamp_errors([recording])[0]


def stamp_errors(recordings: Sequence[Recording]) -> tuple[float, list[np.ndarray]]:
    """Standard deviation of the stamps of logs of one clock, s, and how late (T,) s each stamp probably is; 0 where none.

    The errors are conditional means: where a log does not show a stamp's error, it is nearly none.
    """
    heard = [_listen(r) for r in recordings]
    trust = _share_of_unevenness(heard)
    rests = [w.rest - w.seen(trust * w.uneven) for w in heard]
    further = _common_variance(heard, rests)
    unevenness = np.concatenate([w.uneven for w in heard])
    found = []
    for w, rest in zip(heard, rests, strict=True):
        late = trust * w.uneven + (_common_part(w, rest, further) if further > 0 else 0.0)
        found.append(np.clip(late, -WIDEST * w.period, WIDEST * w.period))
    return float(np.sqrt(trust**2 * np.mean(unevenness**2) + further)), found


def _listen(recording: Recording) -> _Witness:
    time, sigma = recording.time, np.maximum(recording.sigma, 1e-5)
    smooth, slope = _local_cubic(time, smoothing_half(recording))
    highpass = csr_array(eye_array(len(time)) - smooth)
    piece = ((time - time[0]) / STRETCH).astype(int)
    speed = slope @ (recording.position / sigma)
    period = float(np.median(np.diff(time)))
    return _Witness(highpass @ (recording.position / sigma), speed, _unevenness(time), highpass, period, piece)


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
    """How late (T,) s each stamp is on the even clock of the second around it, drawn anew where samples are lost."""
    usual, late = float(np.median(np.diff(time))), np.zeros(len(time))
    for part in np.split(np.arange(len(time)), _gaps(time, usual)):
        if len(part) > NEAR:
            late[part] = time[part] - _local_line(time[part])
    late[np.abs(late) < 1e-6 * usual] = 0.0
    return np.clip(late, -WIDEST * usual, WIDEST * usual)


def _gaps(time: np.ndarray, usual: float) -> np.ndarray:
    """Samples before which others are lost: after a long step the stamps stay late, as after a late one they do not."""
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


def _ratio(heard: Sequence[_Witness], parts: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Ratio of two sums over samples, and its standard error by the scatter of the pieces; parts: of log i, (T,) each."""
    above, below = [], []
    for i, w in enumerate(heard):
        for sums, values in zip((above, below), parts(i), strict=True):
            sums.append(np.bincount(w.piece, values))
    top, bottom = np.concatenate(above), np.concatenate(below)
    total = float(bottom.sum())
    if total <= 0:
        return 0.0, np.inf
    ratio = float(top.sum()) / total
    return ratio, float(np.linalg.norm(top - ratio * bottom)) / total


def _share_of_unevenness(heard: Sequence[_Witness]) -> float:
    """Share of the stamps' unevenness that is their error, 0 .. 1: by regression of the positions' rest on it."""

    def parts(i: int) -> tuple[np.ndarray, np.ndarray]:
        expected = heard[i].seen(heard[i].uneven)
        weight = 1.0 / (1.0 + np.sum(expected**2, axis=1))
        return weight * np.sum(expected * heard[i].rest, axis=1), weight * np.sum(expected**2, axis=1)

    share, error = _ratio(heard, parts)
    return min(share, 1.0) if share > max(SURE * error, LEAST) else 0.0


def _common_variance(heard: Sequence[_Witness], rests: Sequence[np.ndarray]) -> float:
    """Variance of the stamps, s^2, from rests (T, n): by products of different joints, whose noises differ."""

    def parts(i: int) -> tuple[np.ndarray, np.ndarray]:
        w = heard[i]
        along, power = w.speed * rests[i], w.speed**2
        kept = np.asarray(w.highpass.multiply(w.highpass).sum(axis=1)).ravel()
        weight = 1.0 / (1.0 + USUAL**2 * power.sum(axis=1)) ** 2
        pairs = [x.sum(axis=1) ** 2 - np.sum(x**2, axis=1) for x in (along, power)]
        return weight * pairs[0], weight * kept * pairs[1]

    variance, error = _ratio(heard, parts)
    return variance if variance > SURE * error else 0.0


def _common_part(w: _Witness, rest: np.ndarray, variance: float) -> np.ndarray:
    """Errors (T,) s of the stamps, their conditional mean given a rest (T, n) and their variance."""
    matrix = diags_array(np.full(len(rest), 1.0 / variance)).tocsc()
    right = np.zeros(len(rest))
    for j in range(rest.shape[1]):
        bent = csr_array(w.highpass @ diags_array(w.speed[:, j]))
        matrix = matrix + (bent.T @ bent).tocsc()
        right -= bent.T @ rest[:, j]
    return np.asarray(spsolve(matrix, right))
