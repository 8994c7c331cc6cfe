"""Effort sensor: how a log's effort depends on the torque. As a property of the log, it is never named as an effect."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class EffortSensor(SignalLaw):
    """The logged effort is the drive's torque times a scale, plus an offset, and may be later than the logged position.

    If a log contains currents, the scale is one over the torque constant and the gear ratio; the offset is the sensor's
    zero, and a constant torque that balances the joint. The delay is that of the drive's current filter and of the bus;
    it is negative if the position is later.
    """

    name = "effort_sensor"
    stage = "effort"
    parameters = (
        Parameter("scale", "1/(N m)", off=1.0, low=-1e5, high=1e5, typical=1.0),
        Parameter("offset", "of effort", off=0.0, low=-1e4, high=1e4, typical=1.0),
        Parameter("delay", "s", off=0.0, low=-0.1, high=0.1, typical=0.02, per="arm", prior=True),
    )
    symptom = "the logged effort is proportional to the torque, differs from it by a constant, or is late"
    reveals = "slow motion through poses of different load"

    @staticmethod
    def law(signal, joint, memory, p):
        """Scale the torque (..., T, n) in N m of T samples, delay it (p.delay (..., n), s), and add the offset."""
        return p.scale * later(signal, p.delay / joint.dt) + p.offset, memory


def later(signal: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """A signal (P, T, n) delayed by a number of samples (P, 1, n), which may be fractional; its end values are held."""
    if not samples.any():
        return signal
    whole = np.floor(samples)
    share = samples - whole
    first = np.arange(signal.shape[-2])[:, None] - whole.astype(int)
    ends = [np.clip(first - k, 0, signal.shape[-2] - 1) for k in (0, 1)]
    one, other = (np.take_along_axis(signal, np.broadcast_to(i, signal.shape), axis=-2) for i in ends)
    return (1 - share) * one + share * other
