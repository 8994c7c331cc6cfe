"""Torque fade: the drive becomes weaker as it warms up."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class TorqueFade(SignalLaw):
    """Share of the drive's torque that is lost with time, 1 - loss (1 - exp(-t / time)).

    Heat follows the mean power over minutes, and no log contains a temperature. Within one log, the loss is therefore a
    function of the time since the log began, and the drive is assumed to be cool at the start.
    """

    name = "torque_fade"
    stage = "drive"
    parameters = (
        Parameter("loss", "1", off=0.0, low=0.0, high=0.9, typical=0.3),
        Parameter("time", "s", off=5.0, low=0.5, high=600.0, typical=5.0, shape=True),
    )
    symptom = "the same move is weaker late in a log than early in it"
    reveals = "one heavy move repeated for minutes, in a log that begins with a cool drive"
    confused_with = ("payload", "torque_saturation", "torque_constant")

    @staticmethod
    def law(signal, joint, memory, p):
        """Scale the torque (B, n) N m."""
        return signal * (1.0 - p.loss * (1.0 - np.exp(-joint.time / p.time))), memory
