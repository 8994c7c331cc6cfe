"""Payload: a mass at the end effector that is not in the model."""

import numpy as np

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class Payload(MechanicsChange):
    """A point mass at the end effector, or a few centimetres away from it.

    x, y, z: from the end effector to the mass, along the axes of the last moving link. Most loads are within 5 cm of
    the end effector. The prior states this, so that a motion that does not determine the position still determines a
    mass.
    """

    name = "payload"
    family = "gravity"
    parameters = (
        Parameter("mass", "kg", off=0.0, low=0.0, high=50.0, typical=0.2, per="arm"),
        *(Parameter(axis, "m", off=0.0, low=-0.3, high=0.3, typical=0.05, per="arm", shape=True, starts=(0.0,), prior=True)
          for axis in "xyz"),
    )  # fmt: skip
    symptom = "every joint that carries weight sags and lags more, most of all when the arm is stretched out"
    reveals = "static poses with the arm retracted and stretched out, and fast moves"
    confused_with = ("torque_bias", "base_tilt", "joint_spring", "rotor_inertia", "torque_fade",
                     "torque_constant")  # fmt: skip

    @staticmethod
    def change(mechanics, p):
        """Add the mass (B, arms) kg at each arm's tip, offset by x, y, z (B, arms) m."""
        offset = np.stack([p.x, p.y, p.z], axis=-1)
        for arm, body in enumerate(mechanics.tip_body):
            mechanics.add_point_mass(int(body), p.mass[:, arm], mechanics.tip_point[arm] + offset[:, arm])
