"""Velocity cascade: the position error sets a speed, and a PI controller of that speed sets the torque."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw
from embodiedreamer_gym.effects.integral_action import HELD


class VelocityCascade(SignalLaw):
    """A speed loop inside the position loop: torque = damping (w + rate integral of w), w = kp error - speed.

    kp is stiffness over damping, and kp error is limited. Without limit and integral, this is the servo's own law.
    """

    name = "velocity_cascade"
    family = "integral"
    stage = "torque"
    parameters = (
        Parameter("rate", "1/s", off=0.0, low=0.0, high=100.0, typical=3.0),
        Parameter("speed", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0, shape=True),
    )
    symptom = "errors at holds vanish, but on a ramp the joint lags by a constant time at any load"
    reveals = "ramps of several speeds with long holds in between, in poses of different weight"
    confused_with = ("integral_action", "gravity_compensation", "torque_bias", "voltage_limit")

    @staticmethod
    def start(signal, p, dt):
        """The integral (B, n) in N m that balances the remaining torque at rest; there is no last speed error yet."""
        return signal * (1.0 - np.exp(-p.rate * HELD)), None

    @staticmethod
    def law(signal, joint, memory, p):
        """Limit the pull to the damping at the highest speed, and add the integral by the trapezoidal rule."""
        integral, last = memory
        most = np.where(np.isfinite(p.speed), joint.damping * np.minimum(p.speed, 1e3), np.inf)
        pull = np.minimum(np.maximum(joint.pull, -most), most)
        error = pull - joint.damping * joint.velocity
        if last is not None:
            integral = integral + p.rate * joint.dt * 0.5 * (error + last)
        return signal + (pull - joint.pull) + integral, (integral, error)
