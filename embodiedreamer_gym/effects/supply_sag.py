"""Supply sag: the drive's supply voltage falls with the current of the motor."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class SupplySag(SignalLaw):
    """A PWM motor whose supply and cables have a resistance: torque (asked - damping * speed) / (1 + sag * |asked|).

    While the PWM is on, for a share d of the time, the motor's current I flows through the supply's resistance r; it
    always flows through the winding's R: d (V - r I) = R I + back-EMF, or I = (d V - back-EMF) / (R + r d). The
    commanded torque corresponds to d V, the servo's damping to the back-EMF; sag is r / R over the stall torque at r =
    0.
    """

    name = "supply_sag"
    family = "limit"
    stage = "torque"
    parameters = (Parameter("sag", "1/(N m)", off=0.0, low=0.0, high=2.0, typical=0.3, scale="1/torque"),)
    symptom = "the heavier the load, the more the joint yields: its stiffness falls with the torque, at any speed"
    reveals = "holds and slow moves under light and heavy load, or logs at several position gains"
    confused_with = ("torque_saturation", "voltage_limit", "load_friction")

    @staticmethod
    def law(signal, joint, memory, p):
        """Divide the commanded torque (B, n) in N m, minus the damping, by 1 + sag * |asked|."""
        drag = joint.damping * joint.velocity
        return (signal - drag) / (1.0 + p.sag * np.abs(signal)) + drag, memory
