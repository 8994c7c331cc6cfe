"""Torque bias: a constant torque, for example from a current offset or a wrong gravity compensation."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class TorqueBias(SignalLaw):
    """A constant extra torque on the joint."""

    name = "torque_bias"
    family = "gravity"
    stage = "load"
    parameters = (Parameter("torque", "N m", off=0.0, low=-6.0, high=6.0, typical=0.1, scale="torque"),)
    symptom = "the joint stops short of or beyond its target, always on the same side, in every pose and direction"
    reveals = "slow motion in two directions through several poses"
    confused_with = ("joint_spring", "encoder_offset", "base_tilt", "direction_dependent_friction", "payload")

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the bias (B, n) N m."""
        return signal + p.torque, memory
