"""A pendulum on a servo, simulated and fitted without the package: spring, damper and gear friction.

Source: equations of github.com/Rhoban/bam (arXiv 2410.08650, models M1 to M5). The servo's torque is gain * stiffness *
error, at most a limit, minus damping * speed; friction is a stopping torque of at most
base + |motor * torque - external * weight| + exp(-|speed / stribeck_speed|) * |the same with static shares|.
sag: the torque falls to torque / (1 + sag * |gain * stiffness * error|), as with a voltage drop at a resistance before
the PWM.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numba as nb
import numpy as np
from scipy.optimize import least_squares

from embodiedreamer_gym.recordings import Recording

GRAVITY = 9.80665  # m/s^2
STEP = 1e-3  # s
# name -> lower bound, start, upper bound
PARAMETERS = {
    "stiffness": (0.02, 0.3, 5.0),  # N m/rad
    "damping": (0.0, 0.03, 1.0),  # N m s/rad, of drive and joint
    "armature": (0.0, 0.003, 0.05),  # kg m^2
    "limit": (0.1, 3.0, 10.0),  # N m
    "offset": (-0.1, 0.0, 0.1),  # rad
    "base": (0.0, 0.02, 0.3),  # N m
    "motor": (0.0, 0.1, 0.9),
    "external": (0.0, 0.1, 0.9),
    "motor_static": (0.0, 0.02, 1.0),
    "external_static": (0.0, 0.02, 1.0),
    "stribeck_speed": (0.02, 0.2, 2.0),  # rad/s
    "sag": (0.0, 0.3, 5.0),  # 1/(N m)
}
COULOMB = ("stiffness", "damping", "armature", "limit", "offset", "base")
GEARS = (*COULOMB, "motor", "motor_static", "stribeck_speed")
EQUAL = {"external": "motor", "external_static": "motor_static"}  # BAM's M4: motor and external shares are the same
SAG = ("sag",)
STARTS = 6


def read_bodies(urdf: Path) -> tuple[float, float]:
    """Weight at a quarter turn, N m, and inertia about the joint, kg m^2, of a URDF with one moving link."""
    root = ElementTree.parse(urdf).getroot()
    mass, inertia, origin = (next(root.iter("inertial")).find(tag) for tag in ("mass", "inertia", "origin"))
    m, own = float(mass.get("value")), float(inertia.get("iyy"))  # pyright: ignore
    length = abs(float(origin.get("xyz").split()[2]))  # pyright: ignore
    return m * GRAVITY * length, m * length**2 + own


@nb.njit(cache=True)
def _simulate(goal, start, speed, gain, p, weight, inertia, dt):
    """Simulate the measured positions (K,) of the pendulum for commands (K,) with time step dt."""
    stiffness, damping, armature, limit, offset, base, motor, external, motor_static, external_static, stribeck, sag = p
    q, v, whole = start - offset, speed, inertia + armature
    seen = np.empty(len(goal))
    for k in range(len(goal)):
        seen[k] = q + offset
        pull = gain * stiffness * (goal[k] - seen[k])
        pull = min(max(pull, -limit), limit)
        torque = (pull - damping * v) / (1.0 + sag * abs(pull))
        load = -weight * np.sin(q)
        rubs = base + abs(motor * torque - external * load)
        rubs += np.exp(-abs(v) / stribeck) * abs(motor_static * torque - external_static * load)
        stop = whole / dt * v + torque + load
        v += (torque + load - min(max(stop, -rubs), rubs)) / whole * dt
        v = min(max(v, -100.0), 100.0)
        q += v * dt
    return seen


class Pendulum:
    """A pendulum with its mass properties, and its logs as (time, command, position, gain)."""

    def __init__(self, logs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, float]], urdf: Path) -> None:
        self.weight, self.inertia = read_bodies(urdf)
        self.logs = []
        for time, command, position, gain in logs:
            grid = np.arange(time[0], time[-1] + STEP, STEP)
            m = int(np.searchsorted(time - time[0], 0.05, side="right"))
            slope, start = np.polyfit(time[:m] - time[0], position[:m], 1)
            slope = slope if abs(slope) > 0.05 else 0.0
            self.logs.append((time, np.interp(grid, time, command), grid, position, gain, start, slope))

    @classmethod
    def of(cls, logs: Sequence[Recording], urdf: Path) -> Pendulum:
        """The pendulum of recordings of one joint."""
        return cls([(r.time, np.asarray(r.command)[:, 0], r.position[:, 0], float(r.gain[0])) for r in logs], urdf)

    def errors(self, values: Mapping[str, float]) -> list[np.ndarray]:
        """Measured minus simulated position (T,) of each log, rad."""
        p = np.array([values[name] for name in PARAMETERS])
        return [
            position - np.interp(time, grid, _simulate(goal, start, speed, gain, p, self.weight, self.inertia, STEP))
            for time, goal, grid, position, gain, start, speed in self.logs
        ]

    def rms(self, values: Mapping[str, float]) -> float:
        """Root mean square error over all samples, rad."""
        return float(np.sqrt(np.mean(np.concatenate(self.errors(values)) ** 2)))

    def fit(self, free: Sequence[str], equal: Mapping[str, str], seed: int = 0) -> dict[str, float]:
        """Fit the `free` PARAMETERS by least squares, best of a few starts; the others are off or set by `equal`."""
        rng = np.random.default_rng(seed)
        off = {name: 0.0 for name in PARAMETERS} | {"stribeck_speed": 0.2, "limit": 10.0}
        low, start, high = (np.array([PARAMETERS[name][k] for name in free]) for k in range(3))

        def values(x: np.ndarray) -> dict[str, float]:
            given = off | dict(zip(free, x.tolist(), strict=True))
            return given | {name: given[other] for name, other in equal.items()}

        def residuals(x: np.ndarray) -> np.ndarray:
            return np.concatenate(self.errors(values(x)))

        fits = []
        for k in range(STARTS):
            x = start if k == 0 else np.clip(start * np.exp(rng.uniform(-1.2, 1.2, len(start))), low, high)
            fits.append(
                least_squares(residuals, x, bounds=(low, high), x_scale=np.maximum(start, 0.02), diff_step=1e-4)
            )
        best = min(fits, key=lambda fit: fit.cost)
        return values(best.x)
