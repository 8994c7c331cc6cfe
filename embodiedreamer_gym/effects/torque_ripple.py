"""Torque ripple: cogging of the motor, or a periodic error of the gear at certain angles."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class TorqueRipple(SignalLaw):
    """A torque that varies periodically with the angle, A sin(N q + phase)."""

    name = "torque_ripple"
    stage = "load"
    parameters = (
        Parameter("amplitude", "N m", off=0.0, low=0.0, high=6.0, typical=0.1, scale="torque"),
        Parameter("frequency", "1/rad", off=10.0, low=1.0, high=200.0, typical=10.0, shape=True,
                  starts=(2, 5, 8, 11, 14, 17, 20, 23, 26, 30, 34, 38, 43, 48, 54, 60, 70, 80, 100)),
        Parameter("phase", "rad", off=0.0, low=-6.3, high=6.3, typical=2.1, shape=True,
                  starts=(0.0, 1.05, 2.1, 3.14, -2.1, -1.05)),
    )  # fmt: skip
    symptom = "the error oscillates with the angle of the joint, at the same angles for every speed"
    reveals = "a slow sweep at constant speed"
    confused_with = ("joint_spring",)
    generalises = ("torque_bias", "joint_spring")  # a ripple of low frequency acts like a spring

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the ripple (B, n) N m."""
        return signal + p.amplitude * np.sin(p.frequency * joint.position + p.phase), memory
