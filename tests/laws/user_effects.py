"""Effects as a user would write them in one file: one of each kind, and one on the drive's torque."""

import numpy as np

from embodiedreamer_gym.effects import MechanicsChange, Parameter, SignalLaw, TorqueBudget


class QuadraticDrag(SignalLaw):
    """A torque against the motion that grows with the square of the speed."""

    name = "quadratic_drag"
    stage = "load"
    parameters = (Parameter("drag", "N m s^2/rad^2", off=0.0, low=0.0, high=1.0, typical=0.02, scale="torque"),)
    symptom = "fast moves fall behind more than in proportion to their speed"
    reveals = "the same move at several speeds"
    confused_with = ("command_rate_limit", "velocity_limit")

    @staticmethod
    def law(signal, joint, memory, p):
        return signal - p.drag * joint.velocity * np.abs(joint.velocity), memory


class TorqueRipple(SignalLaw):
    """A drive whose torque changes with the angle."""

    name = "torque_ripple"
    stage = "drive"
    parameters = (Parameter("amplitude", "1", off=0.0, low=0.0, high=0.5, typical=0.1),)
    symptom = "the torque wavers with the angle"
    reveals = "a slow motion of constant speed"

    @staticmethod
    def law(signal, joint, memory, p):
        return signal * (1 + p.amplitude * np.sin(12 * joint.position)), memory


class SealFriction(TorqueBudget):
    """Friction of one joint's seal, more when it has rested at zero."""

    name = "seal_friction"
    parameters = (Parameter("torque", "N m", off=0.0, low=0.0, high=1.0, typical=0.05, scale="torque"),)
    symptom = "more friction about zero"
    reveals = "slow sweeps through zero"
    confused_with = ("coulomb_friction",)

    @staticmethod
    def friction(joint, p):
        torque = p.torque * (1 + np.exp(-((joint.position / 0.2) ** 2)))
        return torque, torque


class HeavyRotor(MechanicsChange):
    """A rotor heavier than the data sheet says."""

    name = "heavy_rotor"
    parameters = (Parameter("share", "1", off=0.0, low=-0.5, high=5.0, typical=1.0),)
    symptom = "the joint answers late to sudden commands"
    reveals = "steps and fast moves"

    @staticmethod
    def change(mechanics, p):
        mechanics.rotor_inertia = mechanics.rotor_inertia * (1 + p.share)
