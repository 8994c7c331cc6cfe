"""Experiment design: of many motions that the robot may make, the one on which two effects differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis.add_effect import add_effect
from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.engines.clearance import clearance
from embodiedreamer_gym.errors import CalibrationError, ModelError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.motions import MOTIONS, Motion, Span
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording, Recordings
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation import simulate, simulate_sets

COMMAND_HZ = 50.0  # of the proposed commands
PACES = (0.08, 0.25, 0.6, 1.0)  # of the allowed speed
DRAWS = 3  # motions of each kind and pace
REFITTED = 10  # of them, on which the second model is refitted
MARGIN = 0.03  # m kept between parts
RAMP = 1.5  # s over which a motion begins and ends
CLEARANCE_HZ = 12  # at which clearance is checked
NOISE = 5e-4  # of a joint's sensor without recordings, in its unit
TRAINING = ("multisine", "teleoperation")  # motions to which the second effect is fitted, without recordings
Pair = tuple[RobotModel, RobotModel]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A motion to record next, and how well it separates two effects.

    effects: the two to be distinguished.
    joints: names (n,).
    kind: of the motion, a name in `MOTIONS`.
    time: (T,), s.
    command: (T, n) in the joints' units; begins and ends at rest.
    separation: mean square difference of the two models on it, in sensor noises, after the second was fitted to it too.
    ranking: (kind, separation) of the best candidates.
    clearance: least distance to the table, the other arm and the arm itself, m.
    speed, acceleration: (n,) peaks of the commands, per s and s^2.
    models: both fitted models.
    """

    effects: tuple[str, str]
    joints: tuple[str, ...]
    kind: str
    time: np.ndarray
    command: np.ndarray
    separation: float
    ranking: tuple[tuple[str, float], ...]
    clearance: float
    speed: np.ndarray
    acceleration: np.ndarray
    models: Pair = field(repr=False)

    @property
    def decides(self) -> bool:
        """Whether the models differ on it by clearly more than the sensors' noise."""
        return self.separation > 0.2

    def as_dict(self) -> dict:
        """Numbers for JSON, with units."""
        peaks = zip(self.joints, self.speed.tolist(), self.acceleration.tolist(), strict=True)
        return {
            "effects": list(self.effects), "kind": self.kind, "seconds": float(self.time[-1]), "rate": COMMAND_HZ,
            "separation": {"value": self.separation, "unit": "mean square difference in sensor noises"},
            "decides": self.decides, "clearance": {"value": self.clearance, "unit": "m"},
            "peaks": {joint: {"speed": v, "acceleration": a} for joint, v, a in peaks},
            "ranking": [{"kind": kind, "separation": value} for kind, value in self.ranking],
        }  # fmt: skip

    def __str__(self) -> str:
        a, b = self.effects
        tail = "" if self.decides else "; that is too little to decide: these sensors cannot distinguish the two"
        lines = [f"{self.kind}, {self.time[-1]:.1f} s: {a} and {b} differ by {self.separation:.3g} (mean square, in sensor noises){tail}.",
                 f"least distance to the other arm, itself or the table: {1e3 * self.clearance:.0f} mm", ""]  # fmt: skip
        best: dict[str, float] = {}
        for kind, value in self.ranking:
            best[kind] = max(value, best.get(kind, 0.0))
        lines += [f"{kind:<20}{value:>12.3g}" for kind, value in sorted(best.items(), key=lambda item: -item[1])]
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write the commands as csv (time, <joint>.command, ...).

        Raises: EmbodieDreamerError when the file cannot be written.
        """
        header = ",".join(["time", *(f"{joint}.command" for joint in self.joints)])
        with atomic_file(path) as part:
            np.savetxt(part, np.column_stack([self.time, self.command]), "%.6f", ",", header=header, comments="")


@renamed_arguments(rng="seed")
def propose_motion(
    model: RobotModel,
    effects: tuple[str, str],
    recordings: Sequence[Recording] = (),
    seconds: float = 8.0,
    speed: float = 0.5,
    acceleration: float = 6.0,
    reach: float = 0.6,
    centre: np.ndarray | None = None,
    table: float | None = None,
    seed: int | np.random.Generator = 0,
    progress: ProgressCallback | None = None,
) -> Proposal:
    """Find the motion on which a model with one effect and the same model with another differ most (T-optimality).

    Both are fitted to the recordings. Without any, one effect is given its typical size and the other is fitted to
    motions simulated with it, in both roles, and the smaller difference counts (of a law and its special case, only the
    richer law is the ground truth, since it can imitate the special case).

    model: without the two effects.
    effects: names of the two.
    recordings: that both effects must explain.
    seconds: length of the motion before it is slowed down.
    speed: share of the joints' limits.
    acceleration: rad/s^2 (of a gripper: strokes).
    reach: rad to either side of the centre.
    centre: (n,); default: the middle of the recorded or allowed range.
    table: its height in the URDF's root frame, m.
    seed: of the drawn motions.
    progress: is called as the work advances.
    Raises: CalibrationError for effects that are the same or already in the model, ModelError where no motion is safe.
    Source: Atkinson and Fedorov, Biometrika 62 (1975), T-optimal designs.
    """
    rng, progress = np.random.default_rng(0 if seed is None else seed), progress_or_silence(progress)
    first, second = effects
    if first == second:
        raise CalibrationError(f"give two different effects, not {first} twice.")
    for name in effects:
        find_effect(name, model.catalogue)
    span = allowed_span(model, recordings, centre, reach, speed)
    pairs = _fitted(model, effects, recordings, span, rng, progress)
    sigma = np.mean([r.sigma for r in recordings], axis=0) if recordings else np.full(model.n, NOISE)
    trials = [slowed(make(_paced(span, pace), rng, seconds), span, acceleration) for make in MOTIONS.values()
              if make.__name__ != "staircase" for pace in PACES for _ in range(DRAWS)]  # fmt: skip
    clearances = _clearances(model, [command for *_, command in trials], table)
    safe = [(*trial, room) for trial, room in zip(trials, clearances, strict=True) if room > MARGIN]
    if not safe:
        raise ModelError(
            f"none of {len(trials)} motions keeps a clearance of {1e3 * MARGIN:.0f} mm; give another centre or a smaller reach."
        )
    logs = [blank(model, kind, time, command, sigma) for kind, time, command, _ in safe]
    apart = np.min([_separation(pair, logs, sigma) for pair in pairs], axis=0)
    first_ones = np.argsort(-apart)[:REFITTED].tolist()
    for done, k in enumerate(first_ones, 1):
        apart[k] = min(_separation_after_refit(pair, logs[k]) for pair in pairs)
        progress(
            "comparing motions", done, len(first_ones), separation=f"{apart[k]:.3g} (mean square in sensor noises)"
        )
    best = max(first_ones, key=lambda k: apart[k])
    kind, time, command, room = safe[best]
    rates = np.gradient(command, 1 / COMMAND_HZ, axis=0)
    return Proposal(
        (first, second), model.joints, kind, time, command, float(apart[best]),
        tuple(sorted(((safe[k][0], float(apart[k])) for k in first_ones), key=lambda row: -row[1])),
        room, np.abs(rates).max(0), np.abs(np.gradient(rates, 1 / COMMAND_HZ, axis=0)).max(0), pairs[0],
    )  # fmt: skip


def allowed_span(model: RobotModel, recordings: Sequence[Recording], centre, reach: float, speed: float) -> Span:
    """Where the joints may be sent: within the URDF's limits, about the given, recorded or middle position."""
    tree = model.tree
    low, high = np.maximum(tree.lower, -np.pi), np.minimum(tree.upper, np.pi)
    if centre is not None:
        middle = np.asarray(centre, float)
    elif recordings:
        middle = np.median(np.concatenate([r.position for r in recordings]), axis=0)
    else:
        middle = (low + high) / 2
    middle = np.clip(middle, low, high)
    room = np.minimum(np.minimum(middle - low, high - middle), reach)
    fastest = np.where(np.isfinite(tree.velocity), tree.velocity, 2.0)
    return Span(middle, np.maximum(0.95 * room, 1e-3), speed * fastest)


def slowed(motion: Motion, span: Span, acceleration: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Kind, time (T,) and commands (T, n) of a motion, slowed down until its acceleration is allowed, eased in and out."""
    stretch = 1.0
    time, command = eased(motion, span, stretch)
    for _ in range(20):
        rates = np.gradient(command, 1 / COMMAND_HZ, axis=0)
        peak = np.abs(np.gradient(rates, 1 / COMMAND_HZ, axis=0)).max()
        over = max(peak / acceleration, (np.abs(rates).max(0) / span.speed).max() ** 2)
        if over <= 1.0:
            break
        stretch *= min(np.sqrt(over) * 1.02, 2.0)
        time, command = eased(motion, span, stretch)
    return motion.kind, time, command


def eased(motion: Motion, span: Span, stretch: float) -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) and commands (T, n) of a motion slowed down by a factor, that begins and ends at the span's centre."""
    time = np.arange(0.0, motion.duration * stretch + 1e-9, 1 / COMMAND_HZ)
    ease = np.clip(np.minimum(time, time[-1] - time) / RAMP, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    return time, span.centre + ease[:, None] * (motion(time / stretch) - span.centre)


def blank(model: RobotModel, kind: str, time: np.ndarray, command: np.ndarray, sigma: np.ndarray) -> Recording:
    """Commands as a recording that has not been made yet; it starts at rest at the first of them."""
    hold = "linear" if model.command_hold == "unknown" else model.command_hold
    return Recording(kind, model.joints, time, command, command, units=model.units, command_hold=hold, noise=sigma,
                     quantum=np.zeros(model.n))  # fmt: skip


def _paced(span: Span, pace: float) -> Span:
    return Span(span.centre, span.reach, span.speed * pace)


def _clearances(model: RobotModel, commands: Sequence[np.ndarray], table: float | None) -> list[float]:
    """Least distance (m) to anything on each motion."""
    checked = [command[:: round(COMMAND_HZ / CLEARANCE_HZ)] for command in commands]
    ends = np.cumsum([len(part) for part in checked])[:-1]
    return [float(part.min()) for part in np.split(clearance(model, np.concatenate(checked), table), ends)]


def _separation(pair: Pair, logs: Sequence[Recording], sigma: np.ndarray) -> list[float]:
    """Mean square difference of two models on each motion, in sensor noises."""
    runs = [simulate_sets(model, logs) for model in pair]
    return [float(np.mean(((a.position[0] - b.position[0]) / sigma) ** 2)) for a, b in zip(*runs, strict=True)]


def _separation_after_refit(pair: Pair, log: Recording) -> float:
    """Mean square difference that is left on a motion once the second model is refitted to it (linearly)."""
    true, other = pair
    problem = Problem(other, [log.with_(position=simulate(true, log).position)], hold=log.command_hold)
    residuals, jacobian = problem.jacobian(problem.start)
    change = np.linalg.lstsq(jacobian, residuals, rcond=1e-6)[0]
    return float(np.mean((residuals - jacobian @ change) ** 2))


def _fitted(model, effects, recordings, span: Span, rng, progress: ProgressCallback) -> list[Pair]:
    """Pairs of models, with one effect and with the other, fitted to the same motion."""
    if recordings:
        logs = Recordings(recordings)
        one, other = (add_effect(model, name, logs, logs, progress).after.model for name in effects)
        return [(one, other)]
    pairs = zip(effects, reversed(effects), strict=True)  # ground truth, imitation
    pairs = [(true, other) for true, other in pairs if true not in model.catalogue[other].generalises]
    return [_imitation(model, *pair, span, rng, progress) for pair in pairs]


def _imitation(model: RobotModel, true_name: str, other: str, span: Span, rng, progress: ProgressCallback) -> Pair:
    """The model with an effect of its typical size, and with another one fitted to what the first does."""
    true = model.with_effect(true_name)
    values: dict[ParameterKey, dict[str, float]] = {}
    for row in true.parameters().of_effect(true_name):
        _, parameter = true.find_parameter(row.key)
        scale = (row.high - row.low) / (parameter.high - parameter.low)
        values.setdefault(row.key.group, {})[row.key.place] = float(
            np.clip(parameter.typical * scale, row.low, row.high)
        )
    true = true.with_values(values)
    sigma, logs = np.full(model.n, NOISE), []
    for kind in TRAINING:
        log = blank(model, *slowed(MOTIONS[kind](span, rng, 6.0), span, np.inf), sigma)
        logs.append(log.with_(position=simulate(true, log).position + sigma * rng.standard_normal(log.position.shape)))
    return true, add_effect(model, other, Recordings(logs), Recordings(logs), progress).after.model
