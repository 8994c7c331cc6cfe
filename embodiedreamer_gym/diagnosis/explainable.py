"""How much of an effort's error any law could explain: the part that a general regression predicts on held-out motion.

An effect whose law is only nearly right leaves an error, and so does everything that no law of one joint explains, such
as contact, cables and vibration. The regression distinguishes the two. It names no effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording, smooth_motion
from embodiedreamer_gym.robot import RobotModel

FEATURES = 300  # random Fourier features
BANDWIDTH = 0.7  # of their frequencies, relative to one over each signal's standard deviation
SPEEDS = (0.03, 0.1, 0.3)  # widths of smooth steps at zero speed (friction), relative to the joint's rms speed
RIDGES = (0.1, 1.0, 10.0, 100.0, 1000.0)
FOLDS = 6  # consecutive pieces of the training motion
FEWEST = 200  # least number of samples of a joint for a regression


def explainable_chi2(model: RobotModel, train: Sequence[Recording], test: Sequence[Recording]) -> np.ndarray:
    """Held-out mean square residual (n,), in units of sensor noise, of a regression of each joint's effort error.

    The error of each joint is predicted from that joint's position, velocity, acceleration and torque, by ridge
    regression on random Fourier features (Rahimi and Recht, NIPS 2007); the ridge is chosen by cross-validation over
    pieces of time. If the regression does not help a joint, its error is returned unchanged.
    """
    learn, judge = (_errors(model, part) for part in (train, test))
    rng = np.random.default_rng(0)
    frequencies = BANDWIDTH * rng.standard_normal((4, FEATURES))
    phases = rng.uniform(0.0, 2 * np.pi, FEATURES)
    left = np.ones(model.n)
    for j, ((signals, error), (new_signals, new_error)) in enumerate(zip(learn, judge, strict=True)):
        left[j] = np.mean(new_error**2) if len(new_error) else 1.0
        if len(error) < FEWEST or not len(new_error):
            continue
        middle, size = signals.mean(axis=0), np.maximum(signals.std(axis=0), 1e-12)
        x, new_x = (
            _features((s - middle) / size, s[:, 1], size[1], frequencies, phases) for s in (signals, new_signals)
        )
        weights = _ridge(x, error, _best_ridge(x, error))
        left[j] = min(left[j], float(np.mean((new_error - new_x @ weights) ** 2)))
    return left


def _errors(model: RobotModel, recordings: Sequence[Recording]) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each joint, signals (N, 4) and errors (N,) in units of sensor noise at the usable samples."""
    compared = Signals(model, recordings)
    runs = compared.runs(model)
    errors = [error[0] / compared.sigma for error in compared.errors(runs)]
    motions = [smooth_motion(r) for r in recordings]
    joints = []
    for j in range(model.n):
        parts = [
            np.column_stack([m.position[:, j], m.velocity[:, j], m.acceleration[:, j], run.torque[0][:, j], e[:, j]])[
                u[:, j]
            ]
            for m, run, e, u in zip(motions, runs, errors, compared.usable, strict=True)
        ]
        table = np.concatenate(parts)
        joints.append((table[:, :4], table[:, 4]))
    return joints


def _features(
    x: np.ndarray, velocity: np.ndarray, speed: float, frequencies: np.ndarray, phases: np.ndarray
) -> np.ndarray:
    """Features (N, F) of standardised signals (N, 4): constant, linear, smooth steps of the speed, Fourier."""
    steps = [np.tanh(velocity / (share * speed)) for share in SPEEDS]
    return np.column_stack([np.ones(len(x)), x, *steps, np.cos(x @ frequencies + phases)])


def _ridge(x: np.ndarray, y: np.ndarray, ridge: float) -> np.ndarray:
    return np.linalg.solve(x.T @ x + ridge * np.eye(x.shape[1]), x.T @ y)


def _best_ridge(x: np.ndarray, y: np.ndarray) -> float:
    """The ridge with the least error on pieces of time that were left out."""
    return RIDGES[int(np.argmin(_ridge_errors(x, y, np.arange(len(y)) * FOLDS // len(y))))]


def least_ridge_error(x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> float:
    """Least cross-validated sum of squared errors, over ridges, of a regression of y (N,) on x (N, F).

    fold (N,): fold of each sample.
    """
    return float(np.min(_ridge_errors(x, y, fold)))


def _ridge_errors(x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """Cross-validated sum of squared errors for each ridge."""
    normal, target = x.T @ x, x.T @ y
    errors = np.zeros(len(RIDGES))
    for k in np.unique(fold):
        own, answers = x[fold == k], y[fold == k]
        rest, right = normal - own.T @ own, target - own.T @ answers
        for i, ridge in enumerate(RIDGES):
            weights = np.linalg.solve(rest + ridge * np.eye(len(rest)), right)
            errors[i] += np.sum((answers - own @ weights) ** 2)
    return errors
