"""Attribute a model's error to the controller or to the plant, and find the lag of the robot behind its simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.diagnosis.servo_fit import fit_servo
from embodiedreamer_gym.recordings import Recording, sensor_sd, smooth_motion, smoothing_gain
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive, Rollout

EXPLAINED = 0.5  # share of the effort's variance that at least one side must explain, else effort is another quantity
SIGNIFICANT = 0.003  # share of the effort's variance that one side must leave unexplained, else nothing is attributed
LONGEST_LAG, LAG_STEP = 0.25, 0.01  # s
NOISES = ("effort_noise", "speed_noise", "acceleration_noise")
SIMILAR = 0.5  # correlation below which a lag between two motions is meaningless


def controller_share(model: RobotModel, recordings: Sequence[Recording], rollouts: Sequence[Rollout]) -> np.ndarray:
    """Share (n,) of the unexplained effort on the side of the controller (command to effort), not of the plant.

    The controller explains the effort by the torque that the model's servo commands along the measured motion (see
    `fit_servo`). The plant (effort to motion) explains it by gain inverse dynamics + m acceleration + b velocity + c on
    smoothed signals. The part of each side is what it leaves beyond the noise. nan if there is no effort, if neither
    side explains half of it, or if both explain all of it.

    rollouts: the model's runs of the recordings, arrays (T, n).
    """
    share = np.full(model.n, np.nan)
    servo = fit_servo(model, recordings, rollouts)
    if servo is None:
        return share
    logs = [r for r in recordings if r.effort is not None and r.command is not None]
    terms = [_terms(model, r) for r in logs]
    for j in range(model.n):
        effort, plant = (
            np.concatenate([t[name][r.usable[:, j]][..., j] for t, r in zip(terms, logs, strict=True)])
            for name in ("effort", "plant")
        )
        noises = {name: float(np.mean([t[name][:, j] for t in terms])) for name in NOISES}
        if len(effort) > 50 and np.var(effort) > 0:
            controller = float(servo.mean_square[j]), float(servo.variance[j])
            share[j] = _share(effort, plant, noises, controller, float(model.inertia_scale[j]))
    return share


def _terms(model: RobotModel, recording: Recording) -> dict[str, np.ndarray]:
    """Smoothed effort (T, n), regressors (T, k, n) of the plant, and variances (1, n) of the noise."""
    motion, effort = smooth_motion(recording), np.asarray(recording.effort)
    q, v, a = motion.position, motion.velocity, motion.acceleration
    torque = model.bodies.inverse_dynamics(q, v, a, Drive(model).mechanics)[0]
    sds = (sensor_sd(recording.time, effort) * smoothing_gain(recording), motion.speed_noise, motion.acceleration_noise)
    return {
        "effort": smooth_motion(recording, effort).position,
        "plant": np.stack([torque, a, v, np.ones_like(q)], axis=1),
        **{name: sd[None] ** 2 for name, sd in zip(NOISES, sds, strict=True)},
    }


def _share(
    effort: np.ndarray, plant: np.ndarray, noises: dict[str, float], controller: tuple[float, float], inertia: float
) -> float:
    """The controller's share of the residuals of both sides, beyond the noise of the effort and of the regressors.

    controller: mean square of its residual and of its noise.
    """
    total = float(np.var(effort))
    left_c, floor_c = controller
    left_p, (gain, m, b, _) = _least_squares(effort, plant)
    of_effort, of_speed, of_bend = (noises[name] for name in NOISES)
    floor_p = of_effort + (gain * inertia + m) ** 2 * of_bend + b**2 * of_speed
    excess = [left - floor if left > 2 * floor else 0.0 for left, floor in ((left_c, floor_c), (left_p, floor_p))]
    if min(left_c, left_p) > (1 - EXPLAINED) * total or max(excess) < SIGNIFICANT * total:
        return float("nan")
    return excess[0] / (excess[0] + excess[1])


def _least_squares(target: np.ndarray, regressors: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean square residual of a target (T,) after regression on regressors (T, k), and their weights (k,)."""
    size = np.sqrt(np.mean(regressors**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    weights = np.linalg.lstsq(regressors / size, target, rcond=1e-8)[0] / size
    return float(np.mean((target - regressors @ weights) ** 2)), weights


def lags(recordings: Sequence[Recording], rollouts: Sequence[Rollout]) -> np.ndarray:
    """Lag (n,) in ms of the measured motion behind the simulated motion; nan if the two are not similar.

    The lag is the peak of the cross-correlation of both smoothed speeds, over all recordings, within +-250 ms.
    """
    shifts = np.arange(-LONGEST_LAG, LONGEST_LAG + LAG_STEP / 2, LAG_STEP)
    n = len(recordings[0].joints)
    product, power, own = np.zeros((len(shifts), n)), np.zeros((len(shifts), n)), np.zeros(n)
    for recording, run in zip(recordings, rollouts, strict=True):
        inside = (recording.time >= recording.time[0] + LONGEST_LAG) & (
            recording.time <= recording.time[-1] - LONGEST_LAG
        )
        if inside.sum() < 10:
            continue
        measured = smooth_motion(recording).velocity
        simulated = smooth_motion(recording, run.position).velocity
        for j in range(n):
            rows = inside & recording.usable[:, j]
            x, at = measured[rows, j], recording.time[rows]
            for k, shift in enumerate(shifts):
                y = np.interp(at - shift, recording.time, simulated[:, j])
                product[k, j] += x @ y
                power[k, j] += y @ y
            own[j] += x @ x
    size = np.sqrt(power * own)
    likeness = np.where(size > 0, product / np.where(size > 0, size, 1.0), 0.0)
    return np.array([1e3 * _peak(shifts, column) for column in likeness.T])


def _peak(shifts: np.ndarray, likeness: np.ndarray) -> float:
    """Shift of the highest correlation, by a parabola through three points; nan at an end or if it is too low."""
    k = int(np.argmax(likeness))
    if likeness[k] < SIMILAR or k in (0, len(shifts) - 1):
        return float("nan")
    before, top, after = likeness[k - 1 : k + 2]
    bend = before - 2 * top + after
    return float(shifts[k] + (0.5 * (before - after) / bend * LAG_STEP if bend < 0 else 0.0))
