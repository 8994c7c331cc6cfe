"""Quadratic drag: a torque against the motion that grows with the square of the speed."""

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class QuadraticDrag(TorqueBudget):
    """Drag c v|v|, as in grease or air. It is a budget, so it brakes at any size and never reverses a motion."""

    name = "quadratic_drag"
    family = "friction"
    parameters = (Parameter("coefficient", "N m s^2/rad^2", off=0.0, low=0.0, high=6.0, typical=0.05, scale="torque"),)
    symptom = "the lag of fast moves grows faster than their speed"
    reveals = "the same move at several speeds"
    confused_with = ("voltage_limit", "torque_saturation")

    @staticmethod
    def friction(joint, p):
        """Torque (B, n) in N m, proportional to the square of the speed."""
        torque = p.coefficient * joint.velocity**2
        return torque, torque
