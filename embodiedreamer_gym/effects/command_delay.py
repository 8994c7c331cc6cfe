"""Command delay: the servo hears of a command some time after it was logged."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw

LONGEST = 0.25  # s


class CommandDelay(SignalLaw):
    """A pure delay of the command by a fraction of steps, on a line of past commands."""

    name = "command_delay"
    stage = "command"
    parameters = (Parameter("seconds", "s", off=0.0, low=0.0, high=LONGEST, typical=0.03),)
    symptom = "the whole motion comes late by the same time, so the error grows with speed"
    reveals = "fast multisine and steps"
    confused_with = ("command_lowpass", "command_rate_limit")

    @staticmethod
    def start(signal, p, dt):
        """A line (B, n, k) full of the first command, the place where the next one goes, and each delay in steps."""
        steps = np.array(np.broadcast_to(p.seconds / dt, signal.shape))
        slots = int(np.ceil(np.max(steps))) + 2
        first = np.arange(signal.size).reshape(signal.shape) * slots  # of each joint's line, in the flat array
        whole = np.floor(steps).astype(np.intp)
        return np.repeat(signal[..., None], slots, axis=-1), -1, first, whole, steps - whole

    @staticmethod
    def law(signal, joint, memory, p):
        """Linear interpolation between the two neighbours on the line."""
        line, head, first, whole, share = memory
        slots = line.shape[-1]
        head = (head + 1) % slots
        line = line.copy()
        line[..., head] = signal
        later = line.take(first + (head - whole) % slots)
        earlier = line.take(first + (head - whole - 1) % slots)
        return later + share * (earlier - later), (line, head, first, whole, share)
