"""Servo dead zone: small position errors are ignored."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class ServoDeadzone(SignalLaw):
    """A dead zone of half-width `width` on the position error."""

    name = "servo_deadzone"
    family = "dead_zone"
    stage = "servo"
    parameters = (Parameter("width", "rad", off=0.0, low=0.0, high=0.1, typical=0.01),)
    symptom = "near the target the servo gives no torque: a flat error of either sign at holds"
    reveals = "slow ramps and holds in poses without gravity torque"
    confused_with = ("coulomb_friction", "encoder_offset", "backlash")

    @staticmethod
    def law(signal, joint, memory, p):
        """Shrink the error (B, n) towards zero by the width."""
        return signal - np.clip(signal, -p.width, p.width), memory
