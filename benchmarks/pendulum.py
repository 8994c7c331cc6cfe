"""A pendulum on a servo, simulated and fitted on its own: spring, damper and the friction of gears, without the package.

The equations of github.com/Rhoban/bam (arXiv 2410.08650, models M1 to M6 without the quadratic term): the servo's torque is
gain * stiffness * error, at most a limit, less damping * speed; friction is a stopping torque of at most
base + |motor * torque - external * weight| + exp(-|speed / stribeck_speed|) * |...|.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numba as nb
import numpy as np
from scipy.optimize import least_squares

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
}
COULOMB = ("stiffness", "damping", "armature", "limit", "offset", "base")
GEARS = (*COULOMB, "motor", "external")
STARTS = 6


def read_bodies(urdf: Path) -> tuple[float, float]:
    """Weight at a quarter turn, N m, and inertia about the joint, kg m^2, of a URDF with one moving link."""
    inertial = ElementTree.parse(urdf).getroot().find("link[@name='arm']/inertial")
    assert inertial is not None
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    m, own = float(mass.get("value")), float(inertia.get("iyy"))
    length = abs(float(origin.get("xyz").split()[2]))
    return m * GRAVITY * length, m * length**2 + own


@nb.njit(cache=True)
def _simulate(goal, start, speed, gain, p, weight, inertia, dt):
    """Measured positions (K,) of the pendulum under commands (K,), every dt."""
    stiffness, damping, armature, limit, offset, base, motor, external, motor_static, external_static, stribeck = p
    q, v, whole = start - offset, speed, inertia + armature
    seen = np.empty(len(goal))
    for k in range(len(goal)):
        seen[k] = q + offset
        pull = gain * stiffness * (goal[k] - seen[k])
        torque = min(max(pull, -limit), limit) - damping * v
        load = -weight * np.sin(q)
        rubs = base + abs(motor * torque - external * load)
        rubs += np.exp(-abs(v) / stribeck) * abs(motor_static * torque - external_static * load)
        stop = whole / dt * v + torque + load
        v += (torque + load - min(max(stop, -rubs), rubs)) / whole * dt
        v = min(max(v, -100.0), 100.0)
        q += v * dt
    return seen


class Pendulum:
    """Logs of one pendulum: (time, command, position, gain) each, and its bodies."""

    def __init__(self, logs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, float]], urdf: Path) -> None:
        self.weight, self.inertia = read_bodies(urdf)
        self.logs = []
        for time, command, position, gain in logs:
            grid = np.arange(time[0], time[-1] + STEP, STEP)
            m = int(np.searchsorted(time - time[0], 0.05, side="right"))
            slope, start = np.polyfit(time[:m] - time[0], position[:m], 1)
            slope = slope if abs(slope) > 0.05 else 0.0
            self.logs.append((time, np.interp(grid, time, command), grid, position, gain, start, slope))

    def errors(self, values: Mapping[str, float]) -> list[np.ndarray]:
        """Measured less simulated position (T,) of each log, rad."""
        p = np.array([values[name] for name in PARAMETERS])
        return [
            position - np.interp(time, grid, _simulate(goal, start, speed, gain, p, self.weight, self.inertia, STEP))
            for time, goal, grid, position, gain, start, speed in self.logs
        ]

    def rms(self, values: Mapping[str, float]) -> float:
        """Root mean square error over all samples, rad."""
        return float(np.sqrt(np.mean(np.concatenate(self.errors(values)) ** 2)))

    def fit(self, free: Sequence[str], seed: int = 0) -> dict[str, float]:
        """Values of PARAMETERS by least squares over these names, the others off; the best of a few starts."""
        rng = np.random.default_rng(seed)
        off = {name: 0.0 for name in PARAMETERS} | {"stribeck_speed": 0.2, "limit": 10.0}
        low, start, high = (np.array([PARAMETERS[name][k] for name in free]) for k in range(3))

        def residuals(x: np.ndarray) -> np.ndarray:
            return np.concatenate(self.errors(off | dict(zip(free, x.tolist(), strict=True))))

        fits = []
        for k in range(STARTS):
            x = start if k == 0 else np.clip(start * np.exp(rng.uniform(-1.2, 1.2, len(start))), low, high)
            fits.append(
                least_squares(residuals, x, bounds=(low, high), x_scale=np.maximum(start, 0.02), diff_step=1e-4)
            )
        best = min(fits, key=lambda fit: fit.cost)
        return off | dict(zip(free, best.x.tolist(), strict=True))
