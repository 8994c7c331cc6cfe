"""Effects as a user would write them in one file: one of each kind, and one on the drive's torque."""

import numpy as np

from embodiedreamer_gym.effects import MechanicsChange, Parameter, SignalLaw, TorqueBudget


class HoseSpring(SignalLaw):
    """A hose along the arm whose torque grows with the cube of the angle."""

    name = "hose_spring"
    stage = "load"
    parameters = (Parameter("stiffness", "N m/rad^3", off=0.0, low=0.0, high=2.0, typical=0.1, scale="torque"),)
    symptom = "the error grows out of proportion with the bend of the joint"
    reveals = "a slow sweep of one joint through its range"
    confused_with = ("joint_spring",)

    @staticmethod
    def law(signal, joint, memory, p):
        return signal - p.stiffness * joint.position**3, memory


class EccentricGear(SignalLaw):
    """A gear whose ratio, and with it the torque, changes with the angle."""

    name = "eccentric_gear"
    stage = "drive"
    parameters = (Parameter("share", "1", off=0.0, low=0.0, high=0.5, typical=0.1),)
    symptom = "the torque wavers with the angle"
    reveals = "a slow motion of constant speed"

    @staticmethod
    def law(signal, joint, memory, p):
        return signal * (1 + p.share * np.sin(12 * joint.position)), memory


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
