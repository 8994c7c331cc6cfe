"""Command rate limit: the controller moves to a new set point at a limited speed."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class CommandRateLimit(SignalLaw):
    """A limit on the slope of the command (the Cobot Magic ramps 0.01 rad per 40 Hz tick, 0.4 rad/s)."""

    name = "command_rate_limit"
    family = "limit"
    stage = "command"
    parameters = (Parameter("rate", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0),)
    symptom = "steps become ramps of constant slope, while small slow moves are followed exactly"
    reveals = "large steps and fast point-to-point moves"
    confused_with = ("command_lowpass", "command_delay", "voltage_limit")

    @staticmethod
    def start(signal, p, dt):
        """The state of the ramp, which rests at the first command, and its largest change in a step."""
        return signal.copy(), p.rate * dt

    @staticmethod
    def law(signal, joint, memory, p):
        """Follow the command by at most rate * dt per step."""
        value, most = memory
        value = value + np.minimum(np.maximum(signal - value, -most), most)
        return value, (value, most)
