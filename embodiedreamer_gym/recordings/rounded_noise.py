"""Noise of a coarse encoder from flips between neighbouring codes: maximum likelihood over the rests of a signal.

A rest is a period in which the signal stands still, apart from noise and a slow drift.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import ndtr

WINDOW = 8  # samples within which a resting signal is taken as a line

_WINDOWS = 4  # fewest windows of a rest, so that a reversal of a motion does not count as one
_DRIFT = 0.75  # steps; largest difference of the means of a window's halves at rest
_SAME = 0.25  # steps; largest difference of the means of windows of one rest
_SPAN = 4  # codes that a rest may span
_LEAST = 0.1  # steps; smaller noise adds less than 6 % to the rounding error
_ODD = 1e-3  # share of outliers, at any code
_NOISES = np.concatenate([[0.02], np.arange(0.05, 0.61, 0.05)])  # steps; the first represents no noise
_SLOPES = np.linspace(-1.5, 1.5, 5)  # steps per window
_CREEP = (-3, 0, 3)  # offsets of a window from the phase of its rest, in grid points
_PHASES = np.arange(-0.5, _SPAN - 0.5, 1 / 16) + 1 / 32  # steps above the lowest code of a rest


def rounded_noise(x: np.ndarray, quantum: float, whole: np.ndarray) -> float | None:
    """Standard deviation of the white noise of a signal (T,) before rounding, in its unit, from its rests; else None.

    The position of a rest within the encoder's step is unknown, and so are the slope and a small creep of each window
    in it; the likelihood of the codes is averaged over these with equal weights. A noise below 0.1 quantum is returned
    as 0.

    quantum: encoder's step; whole (T // WINDOW,) bool: windows without a gap in time.
    Source: the likelihood of rounded normal values, Heitjan, Statistical Science 4 (1989), "Inference from grouped
    continuous data".
    """
    steps = (x[: whole.size * WINDOW] - np.partition(x, x.size // 2)[x.size // 2]) / quantum
    codes = np.round(steps).astype(int).reshape(-1, WINDOW)
    halves = codes.reshape(-1, 2, WINDOW // 2).mean(axis=2)
    slow = whole & (np.abs(halves[:, 1] - halves[:, 0]) <= _DRIFT) & (np.ptp(codes, axis=1) < _SPAN)
    rest = _rests(codes.mean(axis=1), slow)
    used = slow & (np.bincount(rest)[rest] >= _WINDOWS)
    if not used.any():
        return None
    codes, first = codes[used], np.flatnonzero(np.diff(rest[used], prepend=-1))
    lowest = np.minimum.reduceat(codes.min(axis=1), first)
    above = codes - np.repeat(lowest, np.diff(first, append=len(codes)))[:, None]
    patterns, pattern = np.unique(above, axis=0, return_inverse=True)
    of_rest = np.add.reduceat(_log_likelihood(patterns)[pattern.ravel()], first)
    noise = _likeliest(_log_mean(of_rest).sum(axis=0))
    return noise * quantum if noise > _LEAST else 0.0


def mean_rounding_error(noise: np.ndarray, quantum: np.ndarray) -> np.ndarray:
    """Rms (n,), over positions, of the mean rounding error at a fixed position, in the joints' unit.

    While a joint rests, noise much smaller than the encoder's step does not average out the rounding error, which stays
    constant.

    noise (n,): sd before rounding; quantum (n,): encoder's step.
    Source: Widrow and Kollar, Quantization Noise, 2008: each harmonic of the sawtooth falls by the noise's characteristic function.
    """
    steps = np.divide(noise, quantum, out=np.full(np.shape(quantum), np.inf), where=quantum > 0)
    k = np.arange(1, 9)[:, None]
    return quantum * np.sqrt(np.sum(np.exp(-((2 * np.pi * k * steps) ** 2)) / (2 * (np.pi * k) ** 2), axis=0))


def rest_numbers(x: np.ndarray, quantum: np.ndarray) -> np.ndarray:
    """Rest (T, n) of each sample of signals (T, n), as the index of its first sample: neighbours within one step (n,).

    Each sample of a motion is a rest of its own; so is each sample of a signal without steps.
    """
    rests = np.tile(np.arange(len(x))[:, None], (1, x.shape[1]))
    for j in np.flatnonzero(quantum > 0):
        codes, first = np.round((x[:, j] - x[0, j]) / quantum[j]), 0
        low = high = codes[0]
        for t, code in enumerate(codes):
            low, high = min(low, code), max(high, code)
            if high - low > 1:
                first, low, high = t, code, code
            rests[t, j] = first
    return rests


def _rests(mean: np.ndarray, slow: np.ndarray) -> np.ndarray:
    """Number (W,) of the rest that each window belongs to: consecutive slow windows with nearly the same mean (W,)."""
    rests, rest, start = np.zeros(mean.size, dtype=int), 0, np.nan
    for k in range(mean.size):
        if not (slow[k] and abs(mean[k] - start) <= _SAME):
            rest, start = rest + 1, mean[k] if slow[k] else np.nan
        rests[k] = rest
    return rests


def _log_likelihood(above: np.ndarray) -> np.ndarray:
    """Log likelihood (W, phases, noises) of windows of codes (W, WINDOW) above a rest's lowest, up to _SPAN - 1."""
    shown = (above[:, :, None] == np.arange(_SPAN)).astype(np.float32).reshape(len(above), -1)
    found = shown @ _log_probabilities()
    by_phase = _log_mean(found.reshape(-1, _SLOPES.size, _PHASES.size, _NOISES.size))
    apart = [by_phase[:, np.clip(np.arange(_PHASES.size) + k, 0, _PHASES.size - 1)] for k in _CREEP]
    return _log_mean(np.stack(apart, axis=1))


def _log_mean(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the mean of exp(logs) over the second axis."""
    top = logs.max(axis=1)
    return top + np.log(np.mean(np.exp(logs - top[:, None]), axis=1))


@cache
def _log_probabilities() -> np.ndarray:
    """Log probability (WINDOW * _SPAN, slopes * phases * noises) of each code at each sample of a window."""
    time = (np.arange(WINDOW) + 0.5) / WINDOW - 0.5
    position = time[:, None, None, None, None] * _SLOPES[:, None, None] + _PHASES[:, None]
    code = np.arange(_SPAN)[:, None, None, None]
    inside = ndtr((code + 0.5 - position) / _NOISES) - ndtr((code - 0.5 - position) / _NOISES)
    return np.log((1 - _ODD) * inside + _ODD / _SPAN).reshape(WINDOW * _SPAN, -1).astype(np.float32)


def _likeliest(likelihood: np.ndarray) -> float:
    """Noise, in steps, where the log likelihood on the grid is largest: the vertex of a parabola through three points."""
    k = int(np.argmax(likelihood))
    if k in (0, len(_NOISES) - 1):
        return float(_NOISES[k]) if k else 0.0
    a, b, _ = np.polyfit(_NOISES[k - 1 : k + 2], likelihood[k - 1 : k + 2], 2)
    return float(-b / (2 * a)) if a < 0 else float(_NOISES[k])
