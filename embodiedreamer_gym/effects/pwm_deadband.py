"""Dead band of the servo's output: weak outputs are suppressed, stronger ones begin with a starting force."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class PwmDeadband(SignalLaw):
    """No torque if the servo commands less than a level; above it, the excess and a starting force."""

    name = "pwm_deadband"
    family = "dead_zone"
    stage = "torque"
    parameters = (
        Parameter("level", "N m", off=0.0, low=0.0, high=3.0, typical=0.1, scale="torque"),
        Parameter("start", "N m", off=0.0, low=0.0, high=3.0, typical=0.05, scale="torque"),
    )
    symptom = "near the target the joint moves freely, then the torque sets in with a jump"
    reveals = "slow ramps through poses without gravity torque, and small steps"
    confused_with = ("servo_deadzone", "coulomb_friction", "friction_compensation", "backlash")

    @staticmethod
    def law(signal, joint, memory, p):
        """Change the commanded torque (B, n) in N m, including damping."""
        asked = signal - joint.damping * joint.velocity
        size = np.abs(asked)
        given = np.where(size > p.level, size - p.level + p.start, 0.0)
        return signal + np.sign(asked) * (given - size), memory
