"""Load-dependent friction: the friction of gears is proportional to the torque that they transmit."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class LoadFriction(TorqueBudget):
    """Gear friction |coefficient * drive - external * load|, plus static * |drive - load| near standstill.

    drive is the drive's torque, load the other torque on the joint: a drive that holds a load has the opposite sign, so
    both shares add up. The shares are equal if gears lose as much when they drive as when they are driven back;
    external is zero if only the drive's torque counts.

    Source: Duclusaud, Passault, Padois and Ly, "Extended Friction Models for the Physics Simulation of Servo
    Actuators", arXiv 2410.08650, models M3 (equal shares), M4 (static friction) and M5 (a share for each side).
    """

    name = "load_friction"
    family = "friction"
    feels_external = True
    parameters = (
        Parameter("coefficient", "1", off=0.0, low=0.0, high=0.9, typical=0.1),
        Parameter("external", "1", off=0.0, low=0.0, high=0.9, typical=0.1),
        Parameter("static", "1", off=0.0, low=0.0, high=0.9, typical=0.1),
        Parameter("speed", "rad/s", off=0.2, low=0.005, high=2.0, typical=0.2, shape=True),
    )
    symptom = "friction grows with the torque that the joint carries, so it differs from pose to pose"
    reveals = "the same slow motion in poses of high and of low gravity torque"
    confused_with = ("coulomb_friction", "stribeck_friction", "direction_dependent_friction")

    @staticmethod
    def friction(joint, p):
        """Share of the gears' torque (B, n) in N m; the static part falls with speed as in `StribeckFriction`."""
        torque = np.abs(p.coefficient * joint.torque - p.external * joint.external)
        torque = torque + p.static * np.abs(joint.torque - joint.external) * np.exp(-((joint.velocity / p.speed) ** 2))
        return torque, torque
