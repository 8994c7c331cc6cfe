"""Gravity compensation: the controller carries a share of the arm's weight, computed with its own model."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class GravityCompensation(SignalLaw):
    """Share of the URDF's weight that the servo carries beyond what the model's file states, or less if negative."""

    name = "gravity_compensation"
    family = "gravity"
    stage = "torque"
    parameters = (Parameter("share", "1", off=0.0, low=-1.5, high=1.5, typical=0.3),)
    symptom = "the joint sags in proportion to its weight, but less or more than its stiffness predicts"
    reveals = "static poses with the arm retracted and stretched out, without a load and with a known load"
    confused_with = ("payload", "torque_bias", "integral_action", "joint_spring", "base_tilt")

    @staticmethod
    def law(signal, joint, memory, p):
        """Add a share of the torque (B, n) in N m that holds the nominal links at the measured positions."""
        return signal + p.share * joint.gravity_torque, memory
