"""How much of each joint's error any law could explain, and from which signals, by a general regression.

If the error is far above the sensor noise, the share that an effect explains says little by itself, because contact,
cables and vibration cause errors that no effect explains. The regression gives the upper limit. It names no effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # loads its submodules when they are used

from embodiedreamer_gym.diagnosis.explainable import least_ridge_error
from embodiedreamer_gym.diagnosis.regimes import gravity_torque
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Rollout

SIGNALS = ("command", "motion", "history", "load")
LAGS = (0.05, 0.2, 0.6)  # s, time constants of the low-pass filters
WIDTHS = (0.005, 0.02, 0.06)  # rad, half-widths of the play operators that describe the history of a motion
FEATURES = 100  # random Fourier features
MOST = 20_000  # largest number of samples of a joint that a regression is fitted to


def explainable_shares(model: RobotModel, recordings: Sequence[Recording], hold: str | None = None) -> np.ndarray:
    """Share (n, 4) of each joint's mean square error that is predictable from SIGNALS; each includes those before it.

    Ridge regression on signals of the joint and random Fourier features of them (Rahimi and Recht, NIPS 2007), tested
    on recordings that were left out of the fit; if there is a single recording, on pieces of it. Zero if nothing is
    predictable.
    command: its difference from the position, its speed and low-pass filters of the speed; motion: position, velocity,
    its sign and its square, acceleration; history: play and low-pass filters of the direction; load: gravity torque,
    alone and times the direction.
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
    """Signals (T, k, n) by group, from the recorded command and the simulated motion."""
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
    """Positions (T, n) minus the output of a play operator of a half-width (rad)."""
    y = x.copy()
    for k in range(1, len(x)):
        y[k] = np.clip(y[k - 1], x[k] - width, x[k] + width)
    return x - y
