"""Gradient-boosted trees on the nominal model's error: a correction that names no effect."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task, signal_of
from embodiedreamer_gym.errors import MissingExtraError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.simulation import run_sets

LAGS = (0.05, 0.2)  # s


def answer(task: Task) -> Finding:
    """Learn measured minus nominal from the nominal run, at each sample and shortly before; one regressor per joint."""
    regressor = _regressor()
    logs = [*task.train, *task.test]
    runs = [features(task, log) for log in logs]
    inputs = np.concatenate([columns for columns, _ in runs])
    error = np.concatenate([_measured(log) - nominal for log, (_, nominal) in zip(logs, runs, strict=True)])
    learnt = [regressor(random_state=0).fit(inputs, error[:, j]) for j in range(error.shape[1])]
    found = {}
    for motion in task.predict:
        columns, nominal = features(task, motion)
        found[motion.name] = nominal + np.stack([one.predict(columns) for one in learnt], axis=1)
    return Finding(None, (), found)


def features(task: Task, log: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (T, k) at the samples of a recording, and the nominal model's signal (T, n)."""
    run = run_sets(task.model, [log])[0].at(0)
    nominal = run.effort if signal_of(log) == "effort" else run.position
    now = np.column_stack([run.position, run.velocity, run.torque])
    steps = [max(round(lag * log.hz), 1) for lag in LAGS]
    before = [np.concatenate([np.repeat(now[:1], k, axis=0), now[:-k]]) for k in steps]
    return np.column_stack([now, *before]), nominal


def _measured(log: Recording) -> np.ndarray:
    return np.asarray(log.effort if signal_of(log) == "effort" else log.position)


def _regressor() -> Any:
    try:
        return importlib.import_module("sklearn.ensemble").HistGradientBoostingRegressor
    except ImportError as error:
        raise MissingExtraError(
            "the entry boosted needs scikit-learn, which is not installed; run: pip install 'embodiedreamer-gym[bench]'"
        ) from error
