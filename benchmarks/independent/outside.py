"""Faults that the catalogue lacks: a right answer is that none of its effects explains the recordings."""

from __future__ import annotations

import numpy as np

from benchmarks.independent.fault import TICK, Fault, State, Values


class SpeedDependentDelay(Fault):
    """A bus that falls behind: the delay of a command grows with the command's speed."""

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        speed = np.abs(state.command(state.time) - state.command(state.time - 0.05)) / 0.05
        late = np.minimum(0.3 * self.amount * speed, 0.3)
        reference = reference.copy()
        for j in self.at:
            reference[j] = state.command(state.time - late[j])[j]
        return reference


class Cogging(Fault):
    """A bent shaft with three lobes: it resists the motion at some angles, more at a higher speed."""

    def load(self, state: State) -> np.ndarray:
        wave = np.sin(3 * state.position + 2 * np.pi * self.draw[:, 3])
        return (
            -2 * self.usual * self.amount * (1 + wave) * np.tanh(state.velocity / 0.3) * np.abs(state.velocity) ** 0.5
        )


class CablePull(Fault):
    """A cable that is taut only at one end of the range: a cubic pull, and proportional friction of its sheath."""

    def pull(self, state: State) -> np.ndarray:
        """Pull against the direction of `signs`, (n,), N m; zero where the cable is slack."""
        reach = self.arm.each("reach")
        taut = self.signs * (state.position - self.arm.each("home")) + 0.2 * reach
        return 3 * self.usual * self.amount * (np.maximum(taut, 0) / reach) ** 3

    def load(self, state: State) -> np.ndarray:
        return -self.signs * self.pull(state)

    def friction(self, state: State) -> np.ndarray:
        return 0.5 * self.pull(state)


class TableEdge(Fault):
    """A soft table edge in reach of the tip: it pushes the tip up below a height, without friction."""

    per_arm = True

    def values(self) -> Values:
        return {"size": {"tip": self.size}}

    def begin(self, command: np.ndarray) -> None:
        self.height: float | None = None

    def load(self, state: State) -> float:
        tip = state.plant.tip_place()
        if self.height is None:  # the edge is near the tip's first position, slightly higher or lower
            self.height = float(tip[2]) + 0.03 * (self.draw[0, 1] - 0.7)
            self.beyond = float(np.hypot(*tip[:2])) - 0.05
        deep = max(self.height - tip[2], 0.0) if np.hypot(*tip[:2]) > self.beyond else 0.0
        weight = self.usual.max() / 0.3
        state.plant.push_tip(np.array([0.0, 0.0, 20 * self.size * weight * deep]))
        return 0.0


class GearRunout(Fault):
    """An eccentric gear wheel: the encoder's error is periodic with the turns of the wheel."""

    def measured(self, state: State, position: np.ndarray) -> np.ndarray:
        turns = 3 + 9 * self.draw[:, 2]
        return position + 0.05 * self.amount * np.sin(turns * position + 2 * np.pi * self.draw[:, 3])


class AsymmetricGain(Fault):
    """An amplifier with different halves: errors of one sign give less torque."""

    def error(self, state: State, error: np.ndarray) -> np.ndarray:
        return np.where(error * self.signs > 0, error * (1 - 0.9 * self.amount), error)


class GainDrift(Fault):
    """A proportional gain that rises during the log, by up to a fifth in 6 s; the damping is constant."""

    def error(self, state: State, error: np.ndarray) -> np.ndarray:
        return error * (1 + 0.2 * self.amount * max(state.time, 0.0) / 6.0)


class LostCommands(Fault):
    """A bus that loses packets in bursts: for a part of every second the last command is held."""

    def begin(self, command: np.ndarray) -> None:
        self.kept = command.copy()

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        lost = self.on & ((state.time / (0.7 + 0.6 * self.draw[:, 2]) + self.draw[:, 3]) % 1.0 < 0.6 * self.amount)
        self.kept = np.where(lost & (state.time > TICK), self.kept, reference)
        return self.kept


OUTSIDE: dict[str, type[Fault]] = {
    "speed_dependent_delay": SpeedDependentDelay,
    "cogging": Cogging,
    "cable_pull": CablePull,
    "table_edge": TableEdge,
    "gear_runout": GearRunout,
    "asymmetric_gain": AsymmetricGain,
    "gain_drift": GainDrift,
    "lost_commands": LostCommands,
}
