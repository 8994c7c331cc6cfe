"""Effort sensor: what a log's effort reads for a torque. Not an effect to be named, but a property of the log."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class EffortSensor(SignalLaw):
    """The logged effort is the drive's torque times a scale, plus an offset.

    The scale is one over the torque constant and the gear ratio where a log holds currents; the offset is the sensor's
    zero, and whatever balances the joint with a constant torque.
    """

    name = "effort_sensor"
    stage = "effort"
    parameters = (
        Parameter("scale", "1/(N m)", off=1.0, low=-1e5, high=1e5, typical=1.0),
        Parameter("offset", "of effort", off=0.0, low=-1e4, high=1e4, typical=1.0),
    )
    symptom = "the logged effort is proportional to the torque, or differs from it by a constant"
    reveals = "slow motion through poses of different load"

    @staticmethod
    def law(signal, joint, memory, p):
        """Scale the torque (B, n) N m and add the offset."""
        return p.scale * signal + p.offset, memory
