"""Random motions of many kinds that a robot can execute within its limits and without collisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.engines.clearance import clearance
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.motions import MOTIONS, Motion, Span
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

COMMAND_HZ = 50.0  # Hz, rate of the proposed commands
PACES = (0.08, 0.25, 0.6, 1.0)  # shares of the allowed speed
DRAWS = 3  # motions of each kind and pace
MARGIN = 0.03  # m, least clearance between parts
RAMP = 1.5  # s, duration of the ramps at the start and at the end of a motion
CLEARANCE_HZ = 12  # Hz, rate at which the clearance is checked


@dataclass(frozen=True, eq=False)
class CandidateMotion:
    """A candidate for the proposed motion: kind, time (T,) in s, commands (T, n) and least clearance in m."""

    kind: str
    time: np.ndarray
    command: np.ndarray
    clearance: float


def draw_motions(
    model: RobotModel, span: Span, seconds: float, table: float | None, rng: np.random.Generator
) -> list[CandidateMotion]:  # fmt: skip
    """Draw motions of every kind and pace within the span, and leave out those without enough clearance.

    Raises: ModelError if none is left.
    """
    drawn = [slowed(make(replace(span, speed=span.speed * pace), rng, seconds), span, span.acceleration)
             for make in MOTIONS.values() if make.__name__ != "staircase" for pace in PACES for _ in range(DRAWS)]  # fmt: skip
    clearances = _clearances(model, [command for *_, command in drawn], table)
    safe = [CandidateMotion(*motion, room) for motion, room in zip(drawn, clearances, strict=True) if room > MARGIN]
    if not safe:
        raise ModelError(
            f"none of {len(drawn)} motions keeps a clearance of {1e3 * MARGIN:.0f} mm; give another centre or a smaller reach."
        )
    return safe


def allowed_span(model: RobotModel, recordings: Sequence[Recording], centre, reach: float, speed: float,
                 acceleration: float = np.inf) -> Span:  # fmt: skip
    """Allowed range of the joints: within the URDF's limits, around the given, recorded or middle position."""
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
    return Span(middle, np.maximum(0.95 * room, 1e-3), speed * fastest, acceleration)


def slowed(motion: Motion, span: Span, acceleration: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Kind, time (T,) and commands (T, n) of a motion, slowed down to the allowed speed and acceleration.

    It starts and ends at rest.
    """
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
    """Time (T,) and commands (T, n) of a motion, slowed down by a factor; it starts and ends at the span's centre."""
    time = np.arange(0.0, motion.duration * stretch + 1e-9, 1 / COMMAND_HZ)
    if motion.at_rest:
        return time, motion(time / stretch)
    ease = np.clip(np.minimum(time, time[-1] - time) / RAMP, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    return time, span.centre + ease[:, None] * (motion(time / stretch) - span.centre)


def blank(model: RobotModel, kind: str, time: np.ndarray, command: np.ndarray, sigma: np.ndarray) -> Recording:
    """Commands as a recording without measurements, for a simulation; it starts at rest at the first command."""
    hold = "linear" if model.command_hold == "unknown" else model.command_hold
    return Recording(kind, model.joints, time, command, command, units=model.units, command_hold=hold, noise=sigma,
                     quantum=np.zeros(model.n))  # fmt: skip


def _clearances(model: RobotModel, commands: Sequence[np.ndarray], table: float | None) -> list[float]:
    """Least clearance (m) of each motion."""
    checked = [command[:: round(COMMAND_HZ / CLEARANCE_HZ)] for command in commands]
    ends = np.cumsum([len(part) for part in checked])[:-1]
    return [float(part.min()) for part in np.split(clearance(model, np.concatenate(checked), table), ends)]
