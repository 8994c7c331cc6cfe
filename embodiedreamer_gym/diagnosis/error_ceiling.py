"""How much of each joint's error is explainable at all, and from which signals: a general regression that names nothing.

Where no log comes near its sensor's noise, a share that an effect explains says little by itself: contact, cables and
vibration explain nothing of the rest either. The regression gives the ceiling beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # loads its parts when they are used

from embodiedreamer_gym.diagnosis.explainable import least_ridge_error
from embodiedreamer_gym.diagnosis.regimes import gravity_torque
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Rollout

SIGNALS = ("command", "motion", "history", "load")
LAGS = (0.05, 0.2, 0.6)  # s, of filters of the command's speed
WIDTHS = (0.005, 0.02, 0.06)  # rad, of the play that a motion's history is seen through
FEATURES = 100  # random Fourier features
MOST = 20_000  # samples of a joint that a regression is fitted to


def explainable_shares(model: RobotModel, recordings: Sequence[Recording], hold: str | None = None) -> np.ndarray:
    """Share (n, 4) of each joint's mean square error that is predictable from SIGNALS, each beside those before it.

    Ridge regression on signals of the joint and random Fourier features of them (Rahimi and Recht, NIPS 2007), judged on
    recordings that were left out of the fit; of a single recording on pieces of it. Zero where nothing is predictable.
    command: its distance from the joint, its speed and filters of it; motion: position and velocity, its sign, its square;
    history: play and fading memories of the direction; load: gravity's torque, with the direction.
    """
    compared = Signals(model, recordings)
    runs = compared.runs(model, hold=hold)
    errors = [error[0] for error in compared.errors(runs)]
    tables = [_signals(model, r, run) for r, run in zip(recordings, runs, strict=True)]
    rng = np.random.default_rng(0)
    shares = np.zeros((model.n, len(SIGNALS)))
    for j in range(model.n):
        keep = [np.flatnonzero(u[:, j]) for u in compared.usable]
        step = 1 + sum(map(len, keep)) // MOST
        e = np.concatenate([error[k[::step], j] for error, k in zip(errors, keep, strict=True)])
        if len(e) < 10 * FEATURES or not np.any(e):
            continue
        fold = np.concatenate([np.full(len(k[::step]), i) for i, k in enumerate(keep)])
        if len(recordings) == 1:
            fold = np.arange(len(e)) * 6 // len(e)
        columns = [
            np.concatenate([t[s][:, :, j][k[::step]] for t, k in zip(tables, keep, strict=True)]) for s in SIGNALS
        ]
        for i in range(len(SIGNALS)):
            left = least_ridge_error(_features(np.hstack(columns[: i + 1]), rng), e, fold)
            shares[j, i] = max(1.0 - left / np.sum(e**2), shares[j, i - 1] if i else 0.0)
    return shares


def _features(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Constant, standardised and random Fourier features (N, F) of signals (N, k)."""
    z = (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-12)
    frequencies = rng.standard_normal((z.shape[1], FEATURES)) / np.sqrt(z.shape[1])
    return np.hstack([np.ones((len(z), 1)), z, np.cos(z @ frequencies + rng.uniform(0, 2 * np.pi, FEATURES))])


def _signals(model: RobotModel, recording: Recording, run: Rollout) -> dict[str, np.ndarray]:
    """Signals (T, k, n) by group: of the recorded command, and of the model's own motion under it."""
    q, v = run.position[0], run.velocity[0]
    command = q if recording.command is None else recording.command
    dt = float(np.median(np.diff(recording.time)))
    speed, asked = np.gradient(q, recording.time, axis=0), np.gradient(command, recording.time, axis=0)
    top = np.percentile(np.abs(speed), 99, axis=0) + 1e-9
    way = np.tanh(v / (0.05 * top))
    load = gravity_torque(model, q)
    groups = {
        "command": [command - q, asked, *(_lagged(asked, lag, dt) for lag in LAGS)],
        "motion": [q, v, way, np.tanh(v / (0.3 * top)), v * np.abs(v), np.gradient(v, recording.time, axis=0)],
        "history": [*(_play(q, width) for width in WIDTHS), *(_lagged(way, lag, dt) for lag in LAGS)],
        "load": [load, load * way, np.abs(load) * way],
    }
    return {name: np.stack(signals, axis=1) for name, signals in groups.items()}


def _lagged(x: np.ndarray, lag: float, dt: float) -> np.ndarray:
    """First-order low-pass (T, n) of signals (T, n)."""
    a = float(np.exp(-dt / lag))
    return np.asarray(scipy.signal.lfilter([1 - a], [1, -a], x, axis=0, zi=a * x[:1])[0])


def _play(x: np.ndarray, width: float) -> np.ndarray:
    """What a play of half-width (rad) leaves of positions (T, n)."""
    y = x.copy()
    for k in range(1, len(x)):
        y[k] = np.clip(y[k - 1], x[k] - width, x[k] + width)
    return x - y
