"""Velocity limit: the drive cannot run faster than its voltage allows, in each direction."""

from embodiedreamer_gym.effects.effect import FrictionBudget, Parameter


class VelocityLimit(FrictionBudget):
    """A highest speed per direction, above which the resistance grows without bound."""

    name = "velocity_limit"
    parameters = (
        Parameter("forward", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0),
        Parameter("backward", "rad/s", off=50.0, low=0.05, high=50.0, typical=1.0),
    )
    symptom = "fast moves become ramps of constant slope, perhaps steeper in one direction"
    reveals = "large steps in both directions"
    confused_with = ("command_rate_limit", "torque_saturation")

    @staticmethod
    def speed_range(joint, p):
        """Lowest and highest speed (B, n)."""
        return -p.backward, p.forward
