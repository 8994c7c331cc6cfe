"""Integral action: the servo's torque grows as long as an error remains."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw

HELD = 60.0  # s for which the arm has stood still before a motion


class IntegralAction(SignalLaw):
    """The integral of the position error times stiffness and rate, clamped; at the start it holds the arm still."""

    name = "integral_action"
    family = "integral"
    stage = "torque"
    parameters = (
        Parameter("rate", "1/s", off=0.0, low=0.0, high=50.0, typical=1.0),
        Parameter("limit", "N m", off=1e3, low=0.05, high=1e3, typical=2.0, scale="torque", shape=True),
    )
    symptom = "errors at holds creep to zero in every pose, and fast moves overshoot their target"
    reveals = "long holds after moves, in poses of different weight"
    confused_with = ("velocity_cascade", "gravity_compensation", "torque_bias", "hysteresis", "derivative_on_error")

    @staticmethod
    def start(signal, p, dt):
        """The integral (B, n) in N m that balances the remaining torque at rest; there is no last pull yet."""
        return np.clip(signal * (1.0 - np.exp(-p.rate * HELD)), -p.limit, p.limit), None

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the integral, by the trapezoidal rule."""
        integral, last = memory
        if last is not None:
            integral = integral + p.rate * joint.dt * 0.5 * (joint.pull + last)
            integral = np.minimum(np.maximum(integral, -p.limit), p.limit)
        return signal + integral, (integral, joint.pull.copy())
