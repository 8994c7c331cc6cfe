"""Command delay: the servo receives a command some time after it was logged."""

import numba as nb
import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw

LONGEST = 0.25  # s


class CommandDelay(SignalLaw):
    """A pure delay of the command by a fractional number of steps, from a buffer of past commands."""

    name = "command_delay"
    family = "late_command"
    stage = "command"
    parameters = (Parameter("seconds", "s", off=0.0, low=0.0, high=LONGEST, typical=0.03),)
    symptom = "the whole motion is delayed by a constant time, so the error grows with speed"
    reveals = "a fast multisine and steps"
    confused_with = ("command_lowpass", "command_rate_limit")

    @staticmethod
    def start(signal, p, dt):
        """The last k commands (B, n, k), the latest last; whole steps and fraction of a step of the delay (B, n)."""
        steps = np.array(np.broadcast_to(p.seconds / dt, signal.shape))
        whole = np.floor(steps).astype(np.intp)
        return np.repeat(signal[..., None], int(np.ceil(np.max(steps))) + 2, axis=-1), whole, steps - whole

    @staticmethod
    def law(signal, joint, memory, p):
        """Linear interpolation between two neighbouring commands of the buffer."""
        line, whole, share = memory
        after, out = np.empty(line.shape), np.empty(signal.shape)
        recall(line, signal, whole, share, after, out)
        return out, (after, whole, share)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def recall(line, signal, whole, share, after, out):
    """Append a signal to a buffer, in `after`, and read the delayed signal, in `out`; one compiled call per step."""
    last = line.shape[2] - 1
    for b in range(line.shape[0]):
        for i in range(line.shape[1]):
            after[b, i, :last] = line[b, i, 1:]
            after[b, i, last] = signal[b, i]
            later = after[b, i, last - whole[b, i]]
            out[b, i] = later + share[b, i] * (after[b, i, last - whole[b, i] - 1] - later)
