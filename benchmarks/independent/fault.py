"""What a fault may change: the robot's build, or one of the signals that the servo loop passes on at every tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.independent.arms import Arm
from benchmarks.independent.plant import Plant, Robot, nominal, usual_torque

TICK = 0.001  # s, of the servo
Values = dict[str, dict[str, float]]  # parameter -> joint or end effector -> value


class State:
    """What a fault may look at during a tick; arrays (n,).

    time: s since the log began; command: the commanded path at any time (n,); position and velocity: of the motors;
    torque: of the servo, one tick ago.
    """

    def __init__(self, plant: Plant, command: Callable[[float], np.ndarray]) -> None:
        n = len(plant.motor)
        self.plant, self.command, self.time = plant, command, 0.0
        self.position, self.velocity, self.torque = np.zeros(n), np.zeros(n), np.zeros(n)


class Fault:
    """A fault on some joints; its size is a number from 0 (absent) to 1 (the most that is plausible).

    draw (n, 4), uniform in 0..1, gives the joints their own shares of the size and the shapes. Every hook returns what it
    is given unless a fault overrides it. `values` says what is hidden in the catalogue's parameters where their meaning is
    beyond doubt from docs/effects.md, and in the fault's own elsewhere.
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
        """A drawn direction of each joint, (n,)."""
        return np.where(self.draw[:, 1] < 0.5, -1.0, 1.0)

    def by_joint(self, numbers: np.ndarray) -> dict[str, float]:
        """The numbers (n,) of the joints that have the fault."""
        return {self.arm.names[j]: float(numbers[j]) for j in self.at}

    def values(self) -> Values:
        """What is hidden."""
        return {"size": self.by_joint(self.amount)}

    def build(self, robot: Robot) -> Robot:
        """The robot with other masses, gears or gravity."""
        return robot

    def begin(self, command: np.ndarray) -> None:
        """Forget all memory; the arm has rested at this command (n,)."""

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        """What the servo takes for its command."""
        return reference

    def measured(self, state: State, position: np.ndarray) -> np.ndarray:
        """What the encoder says, to the servo and to the log."""
        return position

    def error(self, state: State, error: np.ndarray) -> np.ndarray:
        """Command less position, in the servo."""
        return error

    def drive(self, state: State, torque: np.ndarray) -> np.ndarray:
        """The torque that the drive gives."""
        return torque

    def load(self, state: State) -> np.ndarray | float:
        """Another torque on the joints, N m."""
        return 0.0

    def friction(self, state: State) -> np.ndarray | float:
        """Dry friction at this moment, N m, never negative."""
        return 0.0
