"""Firmware and power supply of the stand-in's servos; they do not share code with the package's effects.

A torque is passed to MuJoCo's actuator as a shift of its set point by torque / stiffness, so that the actuator's force
range limits it, as a drive's limit applies to the servo's total torque.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import bilinear, lfilter

Array = np.ndarray
CRAWL = 0.01  # rad/s: speed of a command below which friction compensation is proportional to it
PARAMETERS: dict[str, dict[str, tuple[str, int]]] = {
    "profile": {"acceleration": ("joint", 1), "speed": ("joint", 1)},
    "lookahead": {"seconds": ("joint", 0), "inverse_gain": ("joint", 0)},
    "derivative_on_error": {"share": ("joint", 0)},
    "friction_compensation": {"dry": ("joint", -1), "viscous": ("joint", -2)},
    "gravity_compensation": {"share": ("joint", 0)},
    "integral_action": {"rate": ("joint", 0), "limit": ("joint", -1)},
    "velocity_cascade": {"rate": ("joint", 0), "speed": ("joint", 1)},
    "pwm_deadband": {"level": ("joint", -1), "start": ("joint", -1)},
    "supply_sag": {"sag": ("joint", 1)},
}


def trapezoid(goals: Array, state: tuple[float, float], acceleration: float, speed: float, dt: float) -> Array:
    """Positions and speeds (k, 2) of a set point that accelerates towards each goal (k,) and brakes in time.

    state: position and speed before.
    """
    place, pace = state
    top, gain = (speed if speed > 0 else np.inf), acceleration * dt
    out = np.empty((len(goals), 2))
    for k, goal in enumerate(goals.tolist()):
        left = goal - place
        way = 1.0 if left > 0 else -1.0
        if abs(left) <= gain * dt and abs(pace) <= 2 * gain:
            place, pace = goal, 0.0
        else:
            ahead = pace * way
            braking = ahead > 0 and ahead * ahead >= 2 * acceleration * abs(left)
            pace += -way * min(gain, ahead) if braking else way * gain
            pace = min(max(pace, -top), top)
            place += pace * dt
        out[k] = place, pace
    return out


class SecondOrder:
    """A set point x that follows one joint's commands: x'' = gain (command - x - seconds x')."""

    def __init__(self, seconds: float, inverse_gain: float, dt: float, first: float) -> None:
        square = (inverse_gain if inverse_gain > 0 else 0.25) * seconds**2
        self._taps = bilinear([1.0], [square, seconds, 1.0], 1.0 / dt)
        self._first, self._memory = first, np.zeros(2)

    def __call__(self, commands: Array) -> Array:
        """The set points (k,) for the next commands (k,)."""
        out, self._memory = lfilter(*self._taps, commands - self._first, zi=self._memory)
        return out + self._first


class ServoFirmware:
    """Torques (n,) N m of the servos besides stiffness and damping; `integral` is their integrator's state.

    get: gives the values (n,) of a hidden effect's parameter.
    weigh: gravity torque (n,) at measured joints (n,), according to the controller's own model of the arm.
    """

    def __init__(
        self, get: Callable[[str, str], Array], kp: Array, kd: Array, weigh: Callable[[Array], Array] | None, dt: float
    ) -> None:
        self._kp, self._kd, self._weigh, self._dt = kp, kd, weigh, dt
        self._gravity = get("gravity_compensation", "share")
        self._ahead = get("derivative_on_error", "share") * kd + get("friction_compensation", "viscous")
        self._offset = get("encoder_offset", "angle")
        self._dry = get("friction_compensation", "dry")
        self._rate, clamp = get("integral_action", "rate"), get("integral_action", "limit")
        self._clamp = np.where(clamp > 0, clamp, np.inf)
        self._loop, top = get("velocity_cascade", "rate"), get("velocity_cascade", "speed")
        self._top = np.where(top > 0, top, np.inf)
        self._level, self._jump = get("pwm_deadband", "level"), get("pwm_deadband", "start")
        self._sag = get("supply_sag", "sag")
        self._speeding = bool(self._ahead.any() or self._dry.any())
        self._winding = bool(self._rate.any() or self._loop.any() or top.any())
        self._banded = bool(self._level.any() or self._jump.any())
        self._sagging = bool(self._sag.any())
        beside = self._speeding or self._winding or self._banded or self._sagging
        self.counts = beside or bool(self._gravity.any())
        self.integral = np.zeros(len(kp))
        self._last: Array | None = None

    def rest(self, integral: Array) -> None:
        """Reset to rest, with the integrator at `integral` (n,) N m."""
        self.integral, self._last = integral.copy(), None

    def holding(self, weight: Array) -> Array:
        """The integrator's state (n,) N m after a long rest under a gravity torque (n,)."""
        memory = np.where((self._rate > 0) | (self._loop > 0), weight * (1 - self._gravity), 0.0)
        return np.where(self._rate > 0, np.clip(memory, -self._clamp, self._clamp), memory)

    def shift(self, wanted: Array, target: Array, q: Array, v: Array) -> Array:
        """Shift (n,) rad of the set point that produces all these torques.

        wanted: the command; target: the actuator's set point after the dead zone; q, v: of the motors.
        """
        pull = self._kp * (target - q)
        torque = np.zeros(len(q))
        if self._gravity.any() and self._weigh is not None:
            torque += self._gravity * self._weigh(q + self._offset)
        if self._speeding:
            pace = (wanted - (wanted if self._last is None else self._last)) / self._dt
            self._last = wanted.copy()
            torque += self._ahead * pace + self._dry * np.minimum(np.maximum(pace / CRAWL, -1.0), 1.0)
        if self._winding:
            most = self._kd * self._top
            fast = np.minimum(np.maximum(pull, -most), most)
            torque += self.integral + fast - pull
            self.integral = self.integral + self._dt * (self._rate * pull + self._loop * (fast - self._kd * v))
            clamped = np.minimum(np.maximum(self.integral, -self._clamp), self._clamp)
            self.integral = np.where(self._rate > 0, clamped, self.integral)
        if self._banded:
            asked = pull + torque - self._kd * v
            size = np.abs(asked)
            left = np.where(size > self._level, size - self._level + self._jump, 0.0)
            torque += np.where(asked < 0, -1.0, 1.0) * left - asked
        if self._sagging:
            resisted = self._sag * np.abs(pull + torque)  # supply's resistance over the winding's
            torque -= (pull + torque - self._kd * v) * resisted / (1 + resisted)
        return torque / self._kp
