"""Supply sag: the voltage at the drive falls with the current that the motor draws."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class SupplySag(SignalLaw):
    """A motor on PWM whose supply and cables have a resistance: torque (asked - damping * speed) / (1 + sag * |asked|).

    While the PWM is on, for a share d of the time, the motor's current I passes the supply's resistance r, and always its
    winding's R: d (V - r I) = R I + back-EMF, or I = (d V - back-EMF) / (R + r d). What is asked for stands for d V, the servo's
    damping for the back-EMF; sag is r / R over the stall torque at r = 0.
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
        """Divide what is asked for (B, n) N m, less what damping takes of it."""
        drag = joint.damping * joint.velocity
        return (signal - drag) / (1.0 + p.sag * np.abs(signal)) + drag, memory
