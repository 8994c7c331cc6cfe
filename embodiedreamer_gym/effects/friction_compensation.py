"""Friction compensation: the controller adds its estimate of the friction of the commanded motion."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw

SLOW = 0.01  # rad/s, command speed below which the dry part is proportional to it


class FrictionCompensation(SignalLaw):
    """A torque in the direction of the commanded velocity, constant plus proportional. It may exceed the friction."""

    name = "friction_compensation"
    family = "feed-forward"
    stage = "torque"
    parameters = (
        Parameter("dry", "N m", off=0.0, low=0.0, high=6.0, typical=0.1, scale="torque"),
        Parameter("viscous", "N m s/rad", off=0.0, low=0.0, high=6.0, typical=0.05, scale="torque"),
    )
    symptom = "the joint leads its command at reversals, as if its friction were negative"
    reveals = "slow sweeps back and forth with abrupt reversals of the command"
    confused_with = ("derivative_on_error", "coulomb_friction", "pwm_deadband", "command_delay")
    generalises = ("derivative_on_error",)

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the torque (B, n) N m."""
        speed = joint.command_velocity
        return signal + p.dry * np.clip(speed / SLOW, -1.0, 1.0) + p.viscous * speed, memory
