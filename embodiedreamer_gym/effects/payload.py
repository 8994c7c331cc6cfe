"""Payload: a mass at the end effector that is not in the model."""

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class Payload(MechanicsChange):
    """A point mass at the end effector."""

    name = "payload"
    parameters = (Parameter("mass", "kg", off=0.0, low=0.0, high=5.0, typical=0.2, per="arm"),)
    symptom = "every joint that carries weight sags and lags more, most with the arm stretched out"
    reveals = "static poses near and far, and fast moves"
    confused_with = ("torque_bias", "base_tilt", "joint_spring", "rotor_inertia", "torque_fade",
                     "torque_constant")  # fmt: skip

    @staticmethod
    def change(mechanics, p):
        """Add the mass (B, arms) kg at each arm's tip."""
        for arm, body in enumerate(mechanics.tip_body):
            mechanics.add_point_mass(int(body), p.mass[:, arm], mechanics.tip_point[arm])
