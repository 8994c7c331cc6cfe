"""Encoder offset: the measured angle differs from the true one by a constant."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class EncoderOffset(SignalLaw):
    """A constant added to the measured angle; the servo uses the measured angle too."""

    name = "encoder_offset"
    family = "gravity"
    stage = "sensor"
    parameters = (Parameter("angle", "rad", off=0.0, low=-0.3, high=0.3, typical=0.05),)
    symptom = "gravity acts as if the arm stood at another angle; vertical axes show no error"
    reveals = "many static poses"
    confused_with = ("torque_bias", "base_tilt", "joint_spring", "payload")

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the offset (B, n) rad."""
        return signal + p.angle, memory
