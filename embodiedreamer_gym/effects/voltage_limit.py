"""Voltage limit: only the voltage above the back-EMF drives the current, so the torque falls with the speed."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class VoltageLimit(TorqueBudget):
    """Torque-speed line of a motor on a fixed voltage or goal PWM: stall torque at rest, zero at the highest speed."""

    name = "voltage_limit"
    family = "limit"
    parameters = (
        Parameter("forward", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0),
        Parameter("backward", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0),
        Parameter("stall_torque", "N m", off=1e3, low=0.05, high=1e3, typical=2.0, scale="torque", shape=True),
    )
    symptom = "fast moves become ramps of constant slope, perhaps steeper in one direction"
    reveals = "large steps in both directions"
    confused_with = ("command_rate_limit", "torque_saturation", "quadratic_drag")
    generalises = ("torque_saturation",)

    @staticmethod
    def drive(joint, p):
        """A line from the stall torque (B, n) in N m at rest to zero at the highest speed of each direction."""
        return np.inf, np.inf, p.forward, p.backward, p.stall_torque
