"""Base class of faults: a fault may change the robot's build, or a signal of the servo loop at every tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.independent.arms import Arm
from benchmarks.independent.plant import Plant, Robot, nominal, usual_torque

TICK = 0.001  # s, period of the servo
Values = dict[str, dict[str, float]]  # parameter -> joint or end effector -> value


class State:
    """State that a fault may read during a tick; arrays (n,).

    time: s since the start of the log; command: function from time to command (n,); position and velocity: of the
    motors;
    torque: servo torque of the previous tick.
    """

    def __init__(self, plant: Plant, command: Callable[[float], np.ndarray]) -> None:
        n = len(plant.motor)
        self.plant, self.command, self.time = plant, command, 0.0
        self.position, self.velocity, self.torque = np.zeros(n), np.zeros(n), np.zeros(n)


class Fault:
    """A fault on some joints; its size is a number from 0 (absent) to 1 (the largest plausible size).

    draw (n, 4), uniform in 0..1, determines each joint's share of the size and its shape parameters. Every hook returns
    its input unless a fault overrides it. `values` gives the ground truth in the catalogue's parameters where
    docs/effects.md defines their meaning unambiguously, and in the fault's own parameters elsewhere.
    """

    per_arm = False

    def __init__(self, arm: Arm, at: np.ndarray, draw: np.ndarray, size: float) -> None:
        self.arm, self.at, self.draw, self.size = arm, at, draw, size
        self.on = np.isin(np.arange(len(arm.joints)), at)
        self.amount = np.where(self.on, size * (0.7 + 0.3 * draw[:, 0]), 0.0)
        self.usual = usual_torque(arm)
        self.nominal = nominal(arm)

    @property
    def signs(self) -> np.ndarray:
        """A random direction (-1 or 1) for each joint, (n,)."""
        return np.where(self.draw[:, 1] < 0.5, -1.0, 1.0)

    def by_joint(self, numbers: np.ndarray) -> dict[str, float]:
        """Joint -> number, from numbers (n,), for the joints that have the fault."""
        return {self.arm.names[j]: float(numbers[j]) for j in self.at}

    def values(self) -> Values:
        """Ground truth of the fault."""
        return {"size": self.by_joint(self.amount)}

    def build(self, robot: Robot) -> Robot:
        """The robot with changed masses, gears or gravity."""
        return robot

    def begin(self, command: np.ndarray) -> None:
        """Reset all memory; the arm rests at this command (n,)."""

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        """Command that the servo uses."""
        return reference

    def measured(self, state: State, position: np.ndarray) -> np.ndarray:
        """Encoder reading, for the servo and for the log."""
        return position

    def error(self, state: State, error: np.ndarray) -> np.ndarray:
        """Position error (command minus position) that the servo uses."""
        return error

    def drive(self, state: State, torque: np.ndarray) -> np.ndarray:
        """Torque of the drive."""
        return torque

    def load(self, state: State) -> np.ndarray | float:
        """Additional torque on the joints, N m."""
        return 0.0

    def friction(self, state: State) -> np.ndarray | float:
        """Current dry friction, N m, not negative."""
        return 0.0
