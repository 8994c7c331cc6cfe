"""Timestamp jitter: each row of a log bears a time that is a little early or late."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class TimestampJitter(SignalLaw):
    """White errors of a log's time stamps, common to an arm's joints; `seconds` is their standard deviation.

    A property of the log: in the plant, of a free run as of an environment, it does nothing. A model that has it is
    compared with a log as its clock would have stamped the run, each stamp's own error is estimated from the log alone.
    """

    name = "timestamp_jitter"
    stage = "clock"
    parameters = (Parameter("seconds", "s", off=0.0, low=0.0, high=0.02, typical=0.003, per="arm"),)
    symptom = "all joints have errors at the same samples, each equal to its speed times the same short time"
    reveals = "fast motion of several joints at once"
    confused_with = ("command_delay",)

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the jitter in quadrature: errors of independent causes; (B, arms) s."""
        return np.hypot(signal, p.seconds), memory
