"""Torque saturation: the drive gives no more than its highest torque."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class TorqueSaturation(SignalLaw):
    """A highest torque of the drive, the same in both directions."""

    name = "torque_saturation"
    stage = "drive"
    parameters = (Parameter("limit", "N m", off=20.0, low=0.1, high=20.0, typical=0.6, scale="torque"),)
    symptom = "heavy or fast moves fall behind while small ones are followed well"
    reveals = "heavy fast moves"
    confused_with = ("velocity_limit", "command_rate_limit")

    @staticmethod
    def law(signal, joint, memory, p):
        """Clip the torque (B, n) N m."""
        return np.clip(signal, -p.limit, p.limit), memory
