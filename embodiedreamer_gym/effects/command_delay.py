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
        """A line (B, n, k) full of the first command, and the place where the next one goes."""
        slots = int(np.ceil(np.max(p.seconds) / dt)) + 2
        return np.repeat(signal[..., None], slots, axis=-1), -1

    @staticmethod
    def law(signal, joint, memory, p):
        """Linear interpolation between the two neighbours on the line."""
        line, head = memory
        slots = line.shape[-1]
        head = (head + 1) % slots
        line[..., head] = signal
        steps = np.broadcast_to(p.seconds / joint.dt, signal.shape)
        whole = np.floor(steps).astype(np.intp)
        later = np.take_along_axis(line, ((head - whole) % slots)[..., None], -1)[..., 0]
        earlier = np.take_along_axis(line, ((head - whole - 1) % slots)[..., None], -1)[..., 0]
        return later + (steps - whole) * (earlier - later), (line, head)
