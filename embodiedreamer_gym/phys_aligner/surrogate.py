"""PhysAligner as the paper describes it: a network learns simulated steps, and parameters are optimised through it.

Source: EmbodieDreamer, "PhysAligner" (simulation data set, surrogate, refinement) and its experiments (a perceptron of
three layers, 50 parameter sets, learning rate 0.001). The paper states neither the width of the network nor the number
of epochs nor the optimiser: 128, 40 epochs and Adam are choices made here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from scipy.signal import savgol_filter

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.search_range import FACTOR, SearchRange
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive
from embodiedreamer_gym.simulation.rollout import command_rule, simulate_sets

DATA = ("real", "simulated")
STATES = 2000  # states S_{t-1} of all recordings that are simulated; more would only need more memory
BATCH = 1024
TRAINING_RATE = 1e-3
CHUNK = 20_000  # parameter sets times states simulated at once


@dataclass(frozen=True, eq=False)
class Transitions:
    """Steps of logs: state (K, 2n), command (K, n) now and after, interval (K,) s, next position, gain (K, n)."""

    state: np.ndarray
    command: np.ndarray
    command_after: np.ndarray
    interval: np.ndarray
    after: np.ndarray
    usable: np.ndarray
    gain: np.ndarray

    def __len__(self) -> int:
        return len(self.state)

    def __getitem__(self, rows) -> Transitions:
        return Transitions(*(v[rows] for v in vars(self).values()))


def surrogate(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback = silent, samples: int = 50,
    epochs: int = 40, lr: float = 1e-3, steps: int = 2000, width: int = 128, factor: float = FACTOR,
    data: str = "real",
) -> np.ndarray:  # fmt: skip
    """Scaled parameters (m,) by the paper's three stages.

    First P_t = Sim_{f,p,d}(a_{t-1}, S_{t-1}) is simulated for random (f, p, d) within a factor of the start. Then a
    perceptron P*_t = M_{f,p,d}(a_{t-1}, S_{t-1}) is trained on the mean square of P*_t - P_t (L_surrogate). Then the
    mean square of P*_t - S_t (L_para) is minimised over (f, p, d). data: "real" simulates one step from each recorded
    state, as the paper does; "simulated" takes the steps of free runs.
    Raises: CalibrationError for fewer than two samples or unknown data.
    """
    if data not in DATA:
        raise CalibrationError(f"the surrogate's data '{data}' is not one of {', '.join(DATA)}.")
    if len(np.unique([r.gain for r in problem.recordings], axis=0)) > 1:
        raise CalibrationError(
            "the surrogate needs recordings with the same gain; use least-squares for recordings with several gains."
        )
    if samples < 2 or epochs < 1 or steps < 1:
        raise CalibrationError("the surrogate needs at least 2 samples, 1 epoch and 1 step of descent.")
    box = SearchRange(problem, factor)
    u = rng.random((samples, len(box.start)))
    real = recorded_steps(problem)
    if len(real) > STATES:
        real = real[np.sort(rng.choice(len(real), STATES, replace=False))]
    states = real if data == "real" else None
    inputs, outputs = _data_set(problem, box.x(u), u, states)
    problem.rollouts += samples
    with _one_thread():
        model = _Surrogate(inputs, outputs, width, rng)
        model.train(inputs, outputs, epochs, rng, progress)
        return box.x(model.refine(real, box.start, lr, steps, progress))


def recorded_steps(problem: Problem) -> Transitions:
    """All steps S_{t-1}, a_{t-1} -> S_t of a problem's recordings; missing velocities are smoothed slopes."""
    parts = []
    for r in problem.recordings:
        command = _command(r)
        velocity = r.velocity if r.velocity is not None else _velocity(r)
        ok = r.usable[1:] & r.usable[:-1]
        state = np.concatenate([r.position, velocity], axis=1)[:-1]
        held = (problem.hold or command_rule(problem.model, r)) == "hold"
        following = command[:-1] if held else command[1:]
        gain = np.broadcast_to(r.gain, ok.shape)
        parts.append((state, command[:-1], following, np.diff(r.time), r.position[1:], ok, gain))
    return Transitions(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _command(recording: Recording) -> np.ndarray:
    """Command (T, n) of a recording; its positions if it has none."""
    return recording.position if recording.command is None else recording.command


def _velocity(recording: Recording) -> np.ndarray:
    window = min(7, len(recording.time) // 2 * 2 - 1)
    smooth = np.asarray(savgol_filter(recording.position, window, min(3, window - 1), axis=0))
    return np.gradient(smooth, recording.time, axis=0)


def step_from(problem: Problem, x: np.ndarray, steps: Transitions) -> np.ndarray:
    """Positions (P, K, n) one sample later, simulated with scaled parameters (P, m) from each of K states."""
    sets, p, n = problem.sets(x), len(x), problem.model.n
    size = max(1, CHUNK // p)
    parts = [_step(problem, sets, p, n, steps[k : k + size]) for k in range(0, len(steps), size)]
    return np.concatenate(parts, axis=1)


def _step(problem: Problem, sets, p: int, n: int, steps: Transitions) -> np.ndarray:
    count = len(steps)
    drive = Drive(problem.model, sets, count, gains=steps.gain)
    drive.start(*(np.repeat(v, p, axis=0) for v in (steps.state[:, :n], steps.state[:, n:], steps.command)))
    place = np.repeat(steps.interval, p)[:, None] / TIME_STEP
    result = np.empty((count * p, n))
    before = None
    for k in range(int(np.ceil(place.max() - 1e-9)) + 1):
        share = np.clip(k * TIME_STEP / steps.interval, 0.0, 1.0)[:, None]
        heard = steps.command + share * (steps.command_after - steps.command)
        acceleration = drive.accelerate(np.repeat(heard, p, axis=0))
        measured = drive.measured.copy()
        if before is not None:
            f = place - (k - 1)
            now = ((f > 1e-9) & (f <= 1 + 1e-9))[:, 0]
            result[now] = (before + f * (measured - before))[now]
        before = measured
        drive.advance(acceleration)
    return result.reshape(count, p, n).swapaxes(0, 1)


def _data_set(problem: Problem, x: np.ndarray, u: np.ndarray, states: Transitions | None):
    """Inputs (K, 3n + 1 + m) and position changes (K, n) of the simulation data set, float32."""
    if states is not None:
        after = step_from(problem, x, states)
        change = after - states.state[None, :, : problem.model.n]
        inputs = [_inputs(states, np.broadcast_to(v, (len(states), len(v)))) for v in u]
        return np.concatenate(inputs), change.reshape(-1, problem.model.n).astype(np.float32)
    inputs, changes = [], []
    runs = simulate_sets(problem.model, problem.recordings, problem.sets(x), hold=problem.hold)
    for r, run in zip(problem.recordings, runs, strict=True):
        command = _command(r)
        for q, v, own in zip(run.position, run.velocity, u, strict=True):
            state = np.concatenate([q, v], axis=1)[:-1]
            gain = np.broadcast_to(r.gain, r.usable[1:].shape)
            steps = Transitions(state, command[:-1], command[1:], np.diff(r.time), q[1:], r.usable[1:], gain)
            inputs.append(_inputs(steps, np.broadcast_to(own, (len(steps), len(own)))))
            changes.append(np.diff(q, axis=0))
    return np.concatenate(inputs), np.concatenate(changes).astype(np.float32)


def _inputs(steps: Transitions, u: np.ndarray) -> np.ndarray:
    parts = (steps.state, steps.command, steps.interval[:, None], u)
    return np.concatenate(parts, axis=1).astype(np.float32)


class _Surrogate:
    """M_{f,p,d}: a perceptron of three layers from (S_{t-1}, a_{t-1}, f, p, d) to the next position."""

    def __init__(self, inputs: np.ndarray, outputs: np.ndarray, width: int, rng: np.random.Generator) -> None:
        self._mean, self._sd = inputs.mean(0), inputs.std(0)
        self._sd[self._sd < 1e-7] = 1.0
        self._scale = np.maximum(outputs.std(0), 1e-9)
        self._layers = []
        for a, b in ((inputs.shape[1], width), (width, width), (width, outputs.shape[1])):
            weight = rng.uniform(-1, 1, (b, a)) * np.sqrt(3.0 / a)
            self._layers.append(torch.tensor(weight, dtype=torch.float32, requires_grad=True))
            self._layers.append(torch.zeros(b, requires_grad=True))

    def _net(self, x: torch.Tensor) -> torch.Tensor:
        w1, b1, w2, b2, w3, b3 = self._layers
        x = torch.nn.functional.silu(torch.nn.functional.linear(x, w1, b1))
        x = torch.nn.functional.silu(torch.nn.functional.linear(x, w2, b2))
        return torch.nn.functional.linear(x, w3, b3)

    def train(
        self,
        inputs: np.ndarray,
        outputs: np.ndarray,
        epochs: int,
        rng: np.random.Generator,
        progress: ProgressCallback,
    ) -> None:
        """Minimise L_surrogate, the mean square of P*_t - P_t."""
        x = torch.from_numpy((inputs - self._mean) / self._sd)
        y = torch.from_numpy(outputs / self._scale.astype(np.float32))
        optimiser = torch.optim.Adam(self._layers, lr=TRAINING_RATE)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs)
        for epoch in range(epochs):
            total = 0.0
            for rows in torch.from_numpy(rng.permutation(len(x))).split(BATCH):
                loss = torch.mean((self._net(x[rows]) - y[rows]) ** 2)
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                total += float(loss.detach()) * len(rows)
            schedule.step()
            progress("training the surrogate", epoch, epochs, loss=f"{total / len(x):.4g}")

    def refine(
        self, real: Transitions, start: np.ndarray, lr: float, steps: int, progress: ProgressCallback
    ) -> np.ndarray:
        """Minimise L_para, the mean square of P*_t - S_t, over unit coordinates (m,), with fixed weights."""
        n, m = real.after.shape[1], len(start)
        inputs = _inputs(real, np.zeros((len(real), m), np.float32))
        x = torch.from_numpy((inputs[:, :-m] - self._mean[:-m]) / self._sd[:-m])
        y = torch.from_numpy(((real.after - real.state[:, :n]) / self._scale).astype(np.float32))
        mask = torch.from_numpy(real.usable.astype(np.float32))
        mean, sd = torch.from_numpy(self._mean[-m:]), torch.from_numpy(self._sd[-m:])
        for layer in self._layers:
            layer.requires_grad_(False)
        u = torch.tensor(start, dtype=torch.float32, requires_grad=True)
        optimiser = torch.optim.Adam([u], lr=lr)
        for step in range(steps):
            own = ((u - mean) / sd).expand(len(x), m)
            loss = torch.sum(mask * (self._net(torch.cat([x, own], 1)) - y) ** 2) / mask.sum()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            with torch.no_grad():
                u.clamp_(0.0, 1.0)
            if step % 50 == 0:
                progress("fitting through the surrogate", step, steps, loss=f"{float(loss.detach()):.4g}")
        return u.detach().numpy().astype(float)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Use one thread of torch, because results depend on the number of threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
