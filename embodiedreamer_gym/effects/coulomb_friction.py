"""Coulomb friction: a torque of constant size against the motion."""

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class CoulombFriction(TorqueBudget):
    """Dry friction of constant size; the joint sticks while a smaller torque acts on it."""

    name = "coulomb_friction"
    family = "friction"
    parameters = (Parameter("torque", "N m", off=0.0, low=0.0, high=6.0, typical=0.1, scale="torque"),)
    symptom = "the joint sticks at reversals and stops short of its target; the lost torque is the same at every speed"
    reveals = "slow sweeps in both directions"
    confused_with = ("stribeck_friction", "direction_dependent_friction", "load_friction", "servo_deadzone",
                     "hysteresis")  # fmt: skip

    @staticmethod
    def friction(joint, p):
        """Constant torque (B, n) N m in both directions."""
        return p.torque, p.torque
