"""Servo dead zone: small position errors are ignored."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class ServoDeadzone(SignalLaw):
    """A dead zone of half-width `width` on the position error; `jump` sets how much of a larger error counts.

    jump: share of the width by which the error jumps at the edge. 0: the width is subtracted from every error, as with
    the compliance margin of Dynamixel AX servos; 1: an error beyond the width counts in full.
    """

    name = "servo_deadzone"
    family = "dead_zone"
    stage = "servo"
    parameters = (
        Parameter("width", "rad", off=0.0, low=0.0, high=0.1, typical=0.01),
        Parameter("jump", "1", off=0.0, low=0.0, high=1.0, typical=1.0, shape=True),
    )
    symptom = "near the target the servo gives no torque, so errors of either sign remain at holds"
    reveals = "slow ramps, and holds in poses without gravity torque"
    confused_with = ("coulomb_friction", "encoder_offset", "backlash")

    @staticmethod
    def law(signal, joint, memory, p):
        """Reduce the error (B, n) towards zero by the width, or by a smaller amount beyond the width."""
        within = np.clip(signal, -p.width, p.width)
        return signal - np.where(np.abs(signal) > p.width, 1.0 - p.jump, 1.0) * within, memory
