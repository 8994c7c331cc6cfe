"""Smoothed motion: position, speed and acceleration of a logged signal, and what noise is left in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from embodiedreamer_gym.recordings.recording import Recording

SMOOTHED_OVER = 0.12  # s, shorter than the quickest move of a servo-driven joint


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed signal: position, velocity, acceleration (T, n) in unit, unit/s, unit/s^2.

    speed_noise, acceleration_noise (n,): standard deviation that the sensor's noise leaves in them.
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
    dt, (window, order) = 1.0 / recording.hz, _window(recording)
    grid = recording.time[0] + np.arange(max(round(recording.duration / dt) + 1, window)) * dt
    even = np.stack([np.interp(grid, recording.time, x) for x in signal.T], axis=1)
    parts = []
    for k in range(3):
        smooth = np.asarray(savgol_filter(even, window, order, deriv=k, delta=dt, axis=0))
        parts.append(np.stack([np.interp(recording.time, grid, x) for x in smooth.T], axis=1))
    position, velocity, acceleration = parts
    noise = [smoothing_gain(recording, k) * recording.sigma for k in (1, 2)]
    return Motion(position, velocity, acceleration, *noise)


def smoothing_gain(recording: Recording, derivative: int = 0) -> float:
    """Sd of the smoothed signal, or of a derivative, where the signal's own white noise has sd 1."""
    window, order = _window(recording)
    weights = savgol_coeffs(window, order, deriv=derivative, delta=1.0 / recording.hz)
    return float(np.linalg.norm(np.asarray(weights)))


def smoothing_half(recording: Recording) -> int:
    """Samples to either side that smoothing looks at."""
    return _window(recording)[0] // 2


def _window(recording: Recording) -> tuple[int, int]:
    """Samples (odd) and order of the local polynomial."""
    return 2 * max(2, round(SMOOTHED_OVER * recording.hz / 2)) + 1, 3
