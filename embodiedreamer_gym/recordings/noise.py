"""Errors of the position sensor: the encoder's step and the sensor noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.recordings.rounded_noise import WINDOW, rounded_noise

SMALLEST_SIGMA = 1e-5  # rad; smaller estimates are not plausible

_ROUNDING = 4 * float(np.finfo(np.float32).eps)  # logs are often stored as float32
_ORDERS = (2, 3, 4, 5)  # orders of the differences; a higher order removes more of a smooth motion
_GAIN = {2: 6.0, 3: 20.0, 4: 70.0, 5: 252.0}  # variance of the k-th difference of white noise, C(2k, k)
_WINDOW = 16  # samples of a window that is classified as quiet or moving
_JITTER = 0.02  # of a step: variation from which the times of the samples matter
_COARSE = 0.45  # noise, in steps, below which the rounding errors of a resting signal are not independent


def estimate_quantum(x: np.ndarray) -> float:
    """Encoder step of a signal (T,), in its unit: the largest step that divides all differences of its values.

    0 where none is found: continuous signals, constant ones, and those with fewer than 4 changes.
    """
    values = np.unique(np.asarray(x, dtype=float))
    if values.size < 2 or np.count_nonzero(np.diff(x)) < 4:
        return 0.0
    rounding = _ROUNDING * max(float(np.abs(values).max()), float(np.ptp(values)))
    gaps = np.diff(values)
    gaps = np.sort(gaps[gaps > rounding])
    if gaps.size == 0:
        return 0.0
    starts = {float(gaps[int(share * (gaps.size - 1))]) for share in (0.0, 0.01, 0.05, 0.25, 0.5)}
    candidates = sorted({start / divisor for start in starts for divisor in (1, 2, 3)}, reverse=True)
    for candidate in candidates:
        step = _refined(gaps, candidate)
        if step > 10 * rounding and _explains(gaps, step, rounding):
            return step
    return 0.0


def _refined(gaps: np.ndarray, step: float) -> float:
    """Least-squares step, refined from small gaps to large ones: a rough step gives wrong counts for large gaps."""
    for most in (1.5, 4.0, 16.0, 64.0):
        used = gaps[gaps < most * step]
        counts = np.round(used / step)
        if np.any(counts > 0):
            step = float(used @ counts / (counts @ counts))
    return step


def _explains(gaps: np.ndarray, step: float, rounding: float) -> bool:
    """Whether 95 % of the gaps are whole multiples of the step (random gaps would pass at 20 %)."""
    counts = np.round(gaps / step)
    off = np.abs(gaps - counts * step)
    good = (counts >= 1) & (off < 0.1 * step + rounding)
    return bool(good.mean() >= 0.95 and (gaps.size >= 8 or good.all()))


def estimate_noise(time: np.ndarray, x: np.ndarray, quantum: float = 0.0) -> float:
    """Standard deviation of the white sensor noise of a signal (T,), excluding quantisation, in its unit.

    Uses high-order differences of the quieter half of the signal, with outliers clipped, to exclude motion. The
    variance of rounding, quantum^2 / 12, is subtracted; a total within 30 % of it counts as no noise.
    If the step is coarse and the signal rests at times, `rounded_noise` is used instead.
    """
    x = np.asarray(x, dtype=float)
    if x.size < 10 or np.ptp(x) == 0:
        return 0.0
    time = np.asarray(time, dtype=float)
    quiet = _quiet(time, x)
    clocks = (None, time) if _irregular(time) else (None,)  # the steps may be the clock's, or those of late time stamps
    variance = min(_clipped_variance(_differences(x, quiet, k, clock)) / _GAIN[k] for clock in clocks for k in _ORDERS)
    floor = quantum**2 / 12
    noise = 0.0 if variance <= 1.3 * floor else float(np.sqrt(variance - floor))
    if noise >= _COARSE * quantum:
        return noise
    at_rest = rounded_noise(x, quantum, ~_gaps(time, WINDOW))
    return noise if at_rest is None else at_rest


def _quiet(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Samples (T,) bool of the half of the windows that drift least and have no gap in time.

    A window's drift is the difference of the means of its halves: it depends on the motion and hardly on the noise.
    """
    if x.size < 4 * _WINDOW:
        return np.ones(x.size, dtype=bool)
    count = x.size // _WINDOW
    halves = x[: count * _WINDOW].reshape(count, 2, _WINDOW // 2).mean(axis=2)
    drift = np.abs(halves[:, 1] - halves[:, 0])
    gap = _gaps(time, _WINDOW)
    if not gap.all():
        drift[gap] = np.inf
    keep = np.argsort(drift, kind="stable")[: max(4, count // 2)]
    chosen = np.zeros(count, dtype=bool)
    chosen[keep] = True
    quiet = np.zeros(x.size, dtype=bool)
    quiet[: count * _WINDOW] = np.repeat(chosen, _WINDOW)
    return quiet


def _gaps(time: np.ndarray, window: int) -> np.ndarray:
    """Windows (T // window,) bool that hold a gap in time (T,)."""
    count, step = time.size // window, np.diff(time)
    late = np.append(step > 1.5 * np.median(step), False)[: count * window]
    return np.any(late.reshape(count, window), axis=1)


def _differences(x: np.ndarray, quiet: np.ndarray, order: int, time: np.ndarray | None = None) -> np.ndarray:
    """Differences of the given order whose samples are all quiet.

    With the times (T,) of the samples, divided differences of the same variance, which are zero for a polynomial of a
    lower order also if the steps vary.
    """
    inside = np.convolve(quiet, np.ones(order + 1, dtype=int), mode="valid") == order + 1
    if time is None:
        return np.diff(x, order)[inside]
    times, values = (np.lib.stride_tricks.sliding_window_view(one, order + 1)[inside] for one in (time, x))
    apart = times[:, :, None] - times[:, None, :] + np.eye(order + 1)
    weights = 1.0 / apart.prod(axis=2)
    weights *= np.sqrt(_GAIN[order] / (weights**2).sum(axis=1, keepdims=True))
    return (weights * values).sum(axis=1)


def _irregular(time: np.ndarray) -> bool:
    """Whether the steps between the times (T,) vary, apart from gaps."""
    step = np.diff(time)
    median = float(np.median(step))
    return float(np.percentile(np.abs(step[step <= 1.5 * median] - median), 95)) > _JITTER * median


def _clipped_variance(d: np.ndarray) -> float:
    """Variance about zero without outliers beyond 3.5 sd (a median would jump in whole encoder steps)."""
    if d.size == 0:
        return 0.0
    scale = 1.2533 * float(np.abs(d).mean())  # sd of a normal from its mean absolute value
    for _ in range(4):
        inside = d[np.abs(d) <= 3.5 * scale]
        scale = float(np.sqrt(np.mean(inside**2))) if inside.size else 0.0
        if scale == 0.0:
            break
    return scale**2


def sensor_sd(time: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Standard deviation (n,) of the noise and rounding of a signal (T, n) sampled at times (T,)."""
    quantum = np.array([estimate_quantum(x) for x in signal.T])
    pairs = zip(signal.T, quantum, strict=True)
    noise = np.array([estimate_noise(time, x, float(q)) for x, q in pairs])
    return np.sqrt(noise**2 + quantum**2 / 12)


def noise_floor(sigmas: Sequence[np.ndarray]) -> np.ndarray:
    """Sensor sd (n,): the rms of the recordings' values, without those in which the joint stands still."""
    squares = np.array(sigmas) ** 2
    shown = np.maximum((squares > SMALLEST_SIGMA**2).sum(axis=0), 1)
    return np.maximum(np.sqrt(squares.sum(axis=0) / shown), SMALLEST_SIGMA)
