"""Hysteresis: before friction slips, its contacts yield like a spring."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class Hysteresis(SignalLaw):
    """Presliding friction: a torque that builds up over a small travel after each reversal, without hard sticking."""

    name = "hysteresis"
    family = "friction"
    stage = "load"
    passive = True
    parameters = (
        Parameter("torque", "N m", off=0.0, low=0.0, high=6.0, typical=0.1, scale="torque"),
        Parameter("travel", "rad", off=0.02, low=0.004, high=0.5, typical=0.02, shape=True),
    )
    symptom = "after each reversal the torque changes sign only after some travel: small moves trace loops"
    reveals = "small slow moves back and forth, of several sizes"
    confused_with = ("coulomb_friction", "stribeck_friction", "joint_spring")
    generalises = ("coulomb_friction",)

    @staticmethod
    def start(signal, p, dt):
        """The friction torque, which balances the torque that remains at rest; there is no last position yet."""
        return np.clip(signal, -p.torque, p.torque), None

    @staticmethod
    def law(signal, joint, memory, p):
        """Subtract friction F (B, n) N m, dF = (level sign(dq) - F) |dq| / travel, exact for any step (Dahl 1968)."""
        friction, last = memory
        moved = joint.position - (joint.position if last is None else last)
        level = p.torque * np.sign(moved)
        friction = level + (friction - level) * np.exp(-np.abs(moved) / p.travel)
        return signal - friction, (friction, joint.position)
