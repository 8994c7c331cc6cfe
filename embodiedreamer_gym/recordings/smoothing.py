"""Smoothed motion: position, speed and acceleration of a logged signal, and the noise left in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its submodules load on first use

from embodiedreamer_gym.recordings.recording import Recording

SMOOTHED_OVER = 0.12  # s, shorter than the quickest move of a servo-driven joint


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed signal: position, velocity, acceleration (T, n) in unit, unit/s, unit/s^2.

    speed_noise, acceleration_noise (n,): standard deviation of the sensor noise left in them.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    speed_noise: np.ndarray
    acceleration_noise: np.ndarray

    def __repr__(self) -> str:
        return f"Motion(T={len(self.position)}, n={self.position.shape[1]})"


def smooth_motion(recording: Recording, signal: np.ndarray | None = None) -> Motion:
    """Smooth a signal (T, n) of a recording (default: its position) by a local cubic over 0.12 s.

    Source: Savitzky and Golay, Analytical Chemistry 36, 1964; on an even grid at the recording's sampling rate.
    """
    signal = recording.position if signal is None else signal
    parts = [_resampled(recording, *_filtered(recording, signal, k)) for k in range(3)]
    return Motion(*parts, *(smoothing_gain(recording, k) * recording.sigma for k in (1, 2)))


def smooth(recording: Recording, signal: np.ndarray) -> np.ndarray:
    """Smooth a signal (T, n) of a recording as `smooth_motion` does."""
    return _resampled(recording, *_filtered(recording, signal))


def smooth_derivatives(recording: Recording) -> Motion:
    """Smoothed position and its central differences, for quantities that are computed from them and smoothed again.

    The derivatives of `smooth_motion` attenuate a fast motion more than its position does (an acceleration at 2 Hz by 5
    % more). These derivatives do not: efforts computed from them and then smoothed have passed the same filter as
    measured efforts that are smoothed twice. The noise is what is left after the second smoothing.

    Source: parallel filtering of Gautier, ICRA 1997.
    """
    grid, position = _filtered(recording, recording.position)
    velocity = np.gradient(position, 1.0 / recording.hz, axis=0)
    acceleration = np.pad(np.diff(position, 2, axis=0) * recording.hz**2, ((1, 1), (0, 0)), mode="edge")
    noise = [twice_smoothed_gain(recording, k) * recording.sigma for k in (1, 2)]
    return Motion(*(_resampled(recording, grid, x) for x in (position, velocity, acceleration)), *noise)


def smoothing_gain(recording: Recording, derivative: int = 0) -> float:
    """Noise sd of the smoothed signal, or of a derivative, if the signal has white noise of sd 1."""
    window, order = _window(recording)
    weights = scipy.signal.savgol_coeffs(window, order, deriv=derivative, delta=1.0 / recording.hz)
    return float(np.linalg.norm(np.asarray(weights)))


def twice_smoothed_gain(recording: Recording, derivative: int = 0) -> float:
    """Noise sd of the signal smoothed twice, or of its central differences, if the signal has white noise of sd 1."""
    once = np.asarray(scipy.signal.savgol_coeffs(*_window(recording)))
    difference = {0: [1.0], 1: [0.5, 0.0, -0.5], 2: [1.0, -2.0, 1.0]}[derivative]
    weights = np.convolve(np.convolve(once, once), np.array(difference) * recording.hz**derivative)
    return float(np.linalg.norm(weights))


def smoothing_half(recording: Recording) -> int:
    """Number of samples on either side that smoothing uses."""
    return _window(recording)[0] // 2


def _filtered(recording: Recording, signal: np.ndarray, derivative: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """An even grid of times (K,), and on it the smoothed signal or a derivative of it (K, n)."""
    dt, (window, order) = 1.0 / recording.hz, _window(recording)
    grid = recording.time[0] + np.arange(max(round(recording.duration / dt) + 1, window)) * dt
    even = np.stack([np.interp(grid, recording.time, x) for x in signal.T], axis=1)
    return grid, np.asarray(scipy.signal.savgol_filter(even, window, order, deriv=derivative, delta=dt, axis=0))


def _resampled(recording: Recording, grid: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """A signal (K, n) of an even grid at the recording's times, (T, n)."""
    return np.stack([np.interp(recording.time, grid, x) for x in signal.T], axis=1)


def _window(recording: Recording) -> tuple[int, int]:
    """Samples (odd) and order of the local polynomial."""
    return 2 * max(2, round(SMOOTHED_OVER * recording.hz / 2)) + 1, 3
