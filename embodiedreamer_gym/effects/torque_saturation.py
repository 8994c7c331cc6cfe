"""Torque saturation: the drive's torque is limited."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class TorqueSaturation(TorqueBudget):
    """A torque limit of the drive, the same in both directions and at every speed."""

    name = "torque_saturation"
    family = "limit"
    parameters = (Parameter("limit", "N m", off=1e3, low=0.05, high=1e3, typical=0.6, scale="torque"),)
    symptom = "heavy or fast moves fall behind while small ones are followed well"
    reveals = "heavy fast moves"
    confused_with = ("voltage_limit", "command_rate_limit", "quadratic_drag", "torque_fade")

    @staticmethod
    def drive(joint, p):
        """Highest torque (B, n) in N m; no limit of speed."""
        return p.limit, p.limit, np.inf, np.inf, np.inf
