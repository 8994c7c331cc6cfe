"""Lookahead: the controller steers its set point with the position predicted for some time ahead."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class Lookahead(SignalLaw):
    """A second-order filter of the command, x'' = gain (command - x - seconds x'), as in a servoj command."""

    name = "lookahead"
    family = "late_command"
    stage = "command"
    parameters = (
        Parameter("seconds", "s", off=0.0, low=0.0, high=0.5, typical=0.05),
        Parameter("inverse_gain", "1", off=0.25, low=0.02, high=2.0, typical=0.25, shape=True),
    )
    symptom = "the motion is delayed by a nearly constant time, has no corners, and may overshoot a step"
    reveals = "steps, and a multisine that reaches beyond the filter's corner"
    confused_with = ("command_lowpass", "command_delay", "profile", "derivative_on_error")
    generalises = ("command_lowpass",)

    @staticmethod
    def start(signal, p, dt):
        """The set point at rest at the first command (B, n), its speed, and the last command."""
        return signal.copy(), np.zeros_like(signal), signal.copy()

    @staticmethod
    def law(signal, joint, memory, p):
        """Exact response to a command that is linear over the step; inverse_gain is 1 / (gain seconds^2)."""
        place, speed, last = memory
        ahead, slope = np.maximum(p.seconds, 1e-12), (signal - last) / joint.dt
        spread = np.sqrt(1.0 - 4.0 * p.inverse_gain + 0j)
        spread = np.where(np.abs(spread) < 1e-4, 1e-4, spread)  # two equal roots
        roots = [(-1.0 + sign * spread) / (2.0 * p.inverse_gain * ahead) for sign in (1.0, -1.0)]
        away, drift = place - (last - slope * ahead), speed - slope  # relative to the delayed ramp of the command
        first = (drift - roots[1] * away) / (roots[0] - roots[1])
        parts = [first * np.exp(roots[0] * joint.dt), (away - first) * np.exp(roots[1] * joint.dt)]
        place = signal - slope * ahead + np.real(parts[0] + parts[1])
        speed = slope + np.real(parts[0] * roots[0] + parts[1] * roots[1])
        return place, (place, speed, signal.copy())
