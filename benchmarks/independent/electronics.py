"""Faults before the gear: firmware processing of commands and errors, limits of the drive, and encoder errors."""

from __future__ import annotations

import numpy as np

from benchmarks.independent.fault import TICK, Fault, State, Values


class CommandDelay(Fault):
    """A queue of whole servo ticks for the command."""

    def ticks(self) -> np.ndarray:
        """Length of the queue, (n,)."""
        return np.round(0.15 * self.amount / TICK)

    def values(self) -> Values:
        return {"seconds": self.by_joint(self.ticks() * TICK)}

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        reference = reference.copy()
        for j in self.at:
            reference[j] = state.command(state.time - TICK * self.ticks()[j])[j]
        return reference


class CommandLowpass(Fault):
    """The usual first-order recursive filter, y += (c - y) dt / (T + dt)."""

    def values(self) -> Values:
        return {"time_constant": self.by_joint(0.2 * self.amount)}

    def begin(self, command: np.ndarray) -> None:
        self.filtered = command.copy()

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        self.filtered = self.filtered + (reference - self.filtered) * TICK / (0.2 * self.amount + TICK)
        return np.where(self.on, self.filtered, reference)


class CommandRateLimit(Fault):
    """A setpoint whose change per tick is limited."""

    def rate(self) -> np.ndarray:
        """Fastest change, (n,), rad/s."""
        return 0.15 / np.maximum(self.amount, 1e-9)

    def values(self) -> Values:
        return {"rate": self.by_joint(self.rate())}

    def begin(self, command: np.ndarray) -> None:
        self.setpoint = command.copy()

    def reference(self, state: State, reference: np.ndarray) -> np.ndarray:
        step = self.rate() * TICK
        self.setpoint = self.setpoint + np.clip(reference - self.setpoint, -step, step)
        return np.where(self.on, self.setpoint, reference)


class ServoDeadzone(Fault):
    """Errors within a band count as zero; beyond it the firmware subtracts the band, except in half of the robots."""

    def values(self) -> Values:
        return {
            "width": self.by_joint(0.1 * self.amount),
            "jump": self.by_joint(np.full(len(self.on), float(self.jumps))),
        }

    @property
    def jumps(self) -> bool:
        """Whether the whole error is used beyond the band."""
        return bool(self.draw[0, 3] < 0.5)

    def error(self, state: State, error: np.ndarray) -> np.ndarray:
        width = 0.1 * self.amount
        outside = error if self.jumps else error - np.sign(error) * width
        return np.where(np.abs(error) > width, outside, 0.0)


class TorqueSaturation(Fault):
    """A current limit."""

    def limit(self) -> np.ndarray:
        """Largest torque of either sign, (n,), N m."""
        return 0.2 * self.usual / np.maximum(self.amount, 1e-9)

    def values(self) -> Values:
        return {"limit": self.by_joint(self.limit())}

    def drive(self, state: State, torque: np.ndarray) -> np.ndarray:
        return np.clip(torque, -self.limit(), self.limit())


class VoltageLimit(Fault):
    """A motor at full voltage is limited by the line from stall torque to no-load speed; back-EMF assists braking."""

    def free(self) -> np.ndarray:
        """No-load speed, (n,), rad/s."""
        return 0.25 / np.maximum(self.amount, 1e-9)

    def values(self) -> Values:
        stall = self.usual * (2 + 2 * self.draw[:, 2])
        free = self.by_joint(self.free())
        return {"forward": free, "backward": free, "stall_torque": self.by_joint(stall)}

    def drive(self, state: State, torque: np.ndarray) -> np.ndarray:
        stall, back = self.usual * (2 + 2 * self.draw[:, 2]), state.velocity / self.free()
        limited = np.clip(torque, stall * (-1 - back), stall * (1 - back))
        return np.where(self.on, limited, torque)


class EncoderOffset(Fault):
    """The encoder's zero differs from the joint's zero."""

    def values(self) -> Values:
        return {"angle": self.by_joint(0.3 * self.signs * self.amount)}

    def measured(self, state: State, position: np.ndarray) -> np.ndarray:
        return position + 0.3 * self.signs * self.amount


ELECTRONICS: dict[str, type[Fault]] = {
    "command_delay": CommandDelay,
    "command_lowpass": CommandLowpass,
    "command_rate_limit": CommandRateLimit,
    "servo_deadzone": ServoDeadzone,
    "torque_saturation": TorqueSaturation,
    "voltage_limit": VoltageLimit,
    "encoder_offset": EncoderOffset,
}
