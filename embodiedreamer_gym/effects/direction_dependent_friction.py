"""Direction-dependent friction: different levels forward and backward."""

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class DirectionDependentFriction(TorqueBudget):
    """Dry friction with one level for positive and another for negative motion."""

    name = "direction_dependent_friction"
    family = "friction"
    parameters = (
        Parameter("forward", "N m", off=0.0, low=0.0, high=6.0, typical=0.15, scale="torque"),
        Parameter("backward", "N m", off=0.0, low=0.0, high=6.0, typical=0.05, scale="torque"),
    )
    symptom = "the joint lags more in one direction than in the other, in every pose"
    reveals = "the same slow sweep forward and backward"
    confused_with = ("coulomb_friction", "torque_bias", "load_friction")
    generalises = ("coulomb_friction",)

    @staticmethod
    def friction(joint, p):
        """Two constant levels (B, n) N m."""
        return p.forward, p.backward
