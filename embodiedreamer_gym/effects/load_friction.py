"""Load-dependent friction: a share of the torque that the gears transmit."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class LoadFriction(TorqueBudget):
    """Gear friction in proportion to the transmitted torque."""

    name = "load_friction"
    family = "friction"
    parameters = (Parameter("coefficient", "1", off=0.0, low=0.0, high=0.9, typical=0.1),)
    symptom = "friction that grows with the torque the joint carries, so it differs from pose to pose"
    reveals = "the same slow motion in poses of high and of low gravity torque"
    confused_with = ("coulomb_friction", "stribeck_friction", "direction_dependent_friction")

    @staticmethod
    def friction(joint, p):
        """Share of the drive's torque (B, n) N m."""
        torque = p.coefficient * np.abs(joint.torque)
        return torque, torque
