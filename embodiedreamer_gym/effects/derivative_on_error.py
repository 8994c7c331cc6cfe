"""Derivative on error: the servo damps the speed of the error, not only the speed of the joint."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class DerivativeOnError(SignalLaw):
    """Share of the servo's damping that is relative to the command's speed; 1 is a full derivative of the error."""

    name = "derivative_on_error"
    family = "feed-forward"
    stage = "torque"
    parameters = (Parameter("share", "1", off=0.0, low=0.0, high=2.0, typical=0.5),)
    symptom = "the joint follows fast ramps with less lag than its damping allows, and steps begin with a torque peak"
    reveals = "ramps of several speeds, and steps"
    confused_with = ("command_delay", "command_lowpass", "lookahead", "friction_compensation")

    @staticmethod
    def law(signal, joint, memory, p):
        """Add a share of damping times the command's speed (B, n) N m."""
        return signal + p.share * joint.damping * joint.command_velocity, memory
