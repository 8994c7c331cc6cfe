"""Command low-pass: the controller smooths its set point with a first-order filter."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class CommandLowpass(SignalLaw):
    """First-order low-pass filter of the command."""

    name = "command_lowpass"
    family = "late_command"
    stage = "command"
    parameters = (Parameter("time_constant", "s", off=0.0, low=0.0, high=0.5, typical=0.03),)
    symptom = "corners of the command are rounded; fast motion is delayed and too small"
    reveals = "steps, and a multisine that reaches beyond the filter's corner"
    confused_with = ("command_delay", "command_rate_limit", "rotor_inertia")

    @staticmethod
    def start(signal, p, dt):
        """Start the filter at rest at the first command.

        Returns: its output (B, n) and its last input (B, n).
        """
        return signal.copy(), signal.copy()

    @staticmethod
    def law(signal, joint, memory, p):
        """Exact response to a command that is linear over the step: no lag of half a step is added."""
        value, last = memory
        constant = np.maximum(p.time_constant, 1e-12)
        decay = np.exp(-joint.dt / constant)
        slope_share = 1.0 - (constant / joint.dt) * (1.0 - decay)
        value = decay * value + (1.0 - decay - slope_share) * last + slope_share * signal
        return value, (value, signal.copy())
