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
        """The last k commands (B, n, k), the latest last.

        In that array the places (B, 2, n) of each delay's two neighbours, the later one first; the earlier one's share.
        """
        steps = np.array(np.broadcast_to(p.seconds / dt, signal.shape))
        slots = int(np.ceil(np.max(steps))) + 2
        whole = np.floor(steps).astype(np.intp)
        place = np.arange(slots - 1, signal.size * slots, slots).reshape(signal.shape) - whole
        return np.repeat(signal[..., None], slots, axis=-1), np.stack([place, place - 1], axis=1), steps - whole

    @staticmethod
    def law(signal, joint, memory, p):
        """Linear interpolation between the two neighbours on the line."""
        line, places, share = memory
        line = np.concatenate([line[..., 1:], signal[..., None]], axis=-1)
        pairs = line.take(places)
        later = pairs[:, 0]
        return later + share * (pairs[:, 1] - later), (line, places, share)
