"""Backlash: a gap between the teeth of the gears, in which no torque passes from motor to joint."""

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class Backlash(MechanicsChange):
    """A gap between the joint and the motor, at which servo and encoder measure; its sides meet without rebound."""

    name = "backlash"
    family = "gear"
    parameters = (Parameter("gap", "rad", off=0.0, low=0.0, high=0.2, typical=0.02),)
    symptom = "when the load torque changes sign, the motor turns freely for a moment, then hits its load with a jerk"
    reveals = "moves back and forth in poses without gravity torque, where the load torque changes sign"
    confused_with = ("joint_elasticity", "servo_deadzone")

    @staticmethod
    def change(mechanics, p):
        """Widen the gap (B, n) rad."""
        mechanics.gap = mechanics.gap + p.gap
