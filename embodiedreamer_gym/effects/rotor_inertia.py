"""Extra rotor inertia: the motor behind the gear is heavier than in the model."""

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class RotorInertia(MechanicsChange):
    """Inertia of motor and gear at the joint, in addition to the model's own."""

    name = "rotor_inertia"
    parameters = (Parameter("inertia", "kg m^2", off=0.0, low=0.0, high=1.5, typical=0.005, scale="torque"),)
    symptom = "the joint is late at every change of speed and overshoots its target, in any pose and with any load"
    reveals = "steps and fast moves back and forth"
    confused_with = ("payload", "command_lowpass", "joint_elasticity")

    @staticmethod
    def change(mechanics, p):
        """Add the inertia (B, n) kg m^2."""
        mechanics.rotor_inertia = mechanics.rotor_inertia + p.inertia
