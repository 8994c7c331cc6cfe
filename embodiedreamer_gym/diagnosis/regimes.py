"""Regimes: what a joint is doing at each sample, from its command, its smoothed motion and the load on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive

REGIMES = ("hold", "slow", "fast", "reversal", "accelerating", "loaded")
SMOOTHED_OVER = 0.12  # s, shorter than the quickest move of a servo-driven joint
BESIDE = 0.05  # s before and after a change of direction that still belong to the reversal
PAUSE = 0.5  # s; a joint that rests longer between two directions holds, it does not reverse
CERTAIN = 4.0  # a speed of so many of its own standard deviations is a motion


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

    Source: Savitzky and Golay, Analytical Chemistry 36, 1964; on an even grid at the recording's rate.
    """
    signal = recording.position if signal is None else signal
    dt, (window, order) = 1.0 / recording.rate, _window(recording)
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
    weights = savgol_coeffs(window, order, deriv=derivative, delta=1.0 / recording.rate)
    return float(np.linalg.norm(np.asarray(weights)))


def _window(recording: Recording) -> tuple[int, int]:
    """Samples (odd) and order of the local polynomial."""
    return 2 * max(2, round(SMOOTHED_OVER * recording.rate / 2)) + 1, 3


def gravity_torque(model: RobotModel, position: np.ndarray) -> np.ndarray:
    """Torque (T, n) N m that carries the model's weight at joint positions (T, n)."""
    still = np.zeros_like(position)
    mechanics = Drive(model).mechanics
    return model.bodies.inverse_dynamics(np.ascontiguousarray(position), still, still, mechanics)[0]


def regimes(model: RobotModel, recording: Recording) -> dict[str, np.ndarray]:
    """Masks (T, n) by name; a sample holds, is slow or is fast, and besides may be any of the other three.

    hold: neither the joint nor its command moves; slow, fast: below and above 0.4 of the joint's top speed in
    this recording; reversal: around a change of direction; accelerating: above 0.4 of the top acceleration;
    loaded: the model's gravity torque at the measured pose is above 0.7 of its highest in this recording.
    """
    motion = smooth_motion(recording)
    speed, bend = np.abs(motion.velocity), np.abs(motion.acceleration)
    top = np.percentile(speed, 99, axis=0)
    still = np.maximum(0.03 * top, CERTAIN * motion.speed_noise)
    moving = speed > still
    if recording.command is not None:
        asked = np.abs(smooth_motion(recording, recording.command).velocity)
        moving |= asked > np.maximum(0.03 * np.percentile(asked, 99, axis=0), still)
    fast = moving & (speed >= np.maximum(0.4 * top, still))
    highest = np.percentile(bend, 98, axis=0)
    torque = np.abs(gravity_torque(model, motion.position))
    heaviest = torque.max(axis=0)
    return {
        "hold": ~moving,
        "slow": moving & ~fast,
        "fast": fast,
        "reversal": _reversals(recording, motion, still),
        "accelerating": bend > np.maximum(0.4 * highest, CERTAIN * motion.acceleration_noise),
        "loaded": (torque > 0.7 * heaviest) & (heaviest > 0.05 * model.torque_scale),
    }


def _reversals(recording: Recording, motion: Motion, still: np.ndarray) -> np.ndarray:
    """Samples (T, n) between a motion one way and the next motion the other way, and a little beside."""
    time, mask = recording.time, np.zeros(motion.velocity.shape, bool)
    least = np.maximum(0.01 * np.ptp(motion.position, axis=0), CERTAIN * recording.sigma)
    for j, (x, v) in enumerate(zip(motion.position.T, motion.velocity.T, strict=True)):
        moved = np.flatnonzero(np.abs(v) > still[j])
        ends = np.flatnonzero(np.diff(np.sign(v[moved])) != 0)
        firsts, lasts = moved[np.append(0, ends + 1)[: len(moved)]], moved[np.append(ends, -1)[: len(moved)]]
        far = np.abs(x[lasts] - x[firsts]) > least[j]  # the smoothing rings beside a sharp corner
        firsts, lasts = firsts[far], lasts[far]
        for before, after in zip(lasts[:-1], firsts[1:], strict=True):
            if v[before] * v[after] < 0 and time[after] - time[before] <= PAUSE:
                mask[:, j] |= (time >= time[before] - BESIDE) & (time <= time[after] + BESIDE)
    return mask
