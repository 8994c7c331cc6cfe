"""Regimes: what a joint is doing at each sample, from its command, its smoothed motion and the load on it."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.recordings import Motion, Recording, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive

REGIMES = ("hold", "slow", "fast", "reversal", "accelerating", "loaded")
REGIME_HEADS = ("all", "hold", "slow", "fast", "reversal", "accel.", "loaded")  # column heads of a table or a figure
BESIDE = 0.05  # s before and after a change of direction that still belong to the reversal
PAUSE = 0.5  # s; a joint that rests longer between two directions holds, it does not reverse
CERTAIN = 4.0  # standard deviations of its noise above which a speed counts as motion


def gravity_torque(model: RobotModel, position: np.ndarray) -> np.ndarray:
    """Torque (T, n) in N m that holds the model against gravity at joint positions (T, n)."""
    still = np.zeros_like(position)
    mechanics = Drive(model).mechanics
    return model.bodies.inverse_dynamics(np.ascontiguousarray(position), still, still, mechanics)[0]


def regimes(model: RobotModel, recording: Recording) -> dict[str, np.ndarray]:
    """Masks (T, n) by name; a sample is in one of hold, slow and fast, and may also be in any of the other three.

    hold: neither the joint nor its command moves; slow, fast: below and above 0.4 of the joint's top speed in this
    recording; reversal: around a change of direction; accelerating: above 0.4 of the top acceleration; loaded: the
    model's gravity torque at the measured pose is above 0.7 of its highest in this recording.
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
    """Mask (T, n) of the samples between a motion in one direction and the next in the other, with a small margin."""
    time, mask = recording.time, np.zeros(motion.velocity.shape, bool)
    least = np.maximum(0.01 * np.ptp(motion.position, axis=0), CERTAIN * recording.sigma)
    for j, (x, v) in enumerate(zip(motion.position.T, motion.velocity.T, strict=True)):
        moved = np.flatnonzero(np.abs(v) > still[j])
        ends = np.flatnonzero(np.diff(np.sign(v[moved])) != 0)
        firsts, lasts = moved[np.append(0, ends + 1)[: len(moved)]], moved[np.append(ends, -1)[: len(moved)]]
        far = np.abs(x[lasts] - x[firsts]) > least[j]  # the smoothing rings near a sharp corner
        firsts, lasts = firsts[far], lasts[far]
        for before, after in zip(lasts[:-1], firsts[1:], strict=True):
            if v[before] * v[after] < 0 and time[after] - time[before] <= PAUSE:
                mask[:, j] |= (time >= time[before] - BESIDE) & (time <= time[after] + BESIDE)
    return mask
