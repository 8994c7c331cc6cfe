"""Stribeck friction: more friction near standstill than in motion."""

import numpy as np

from embodiedreamer_gym.effects.effect import Parameter, TorqueBudget


class StribeckFriction(TorqueBudget):
    """Dry friction that falls from a static to a sliding level, c + (s - c) exp(-(v/vs)^2)."""

    name = "stribeck_friction"
    family = "friction"
    parameters = (
        Parameter("sliding", "N m", off=0.0, low=0.0, high=6.0, typical=0.05, scale="torque"),
        Parameter("extra_static", "N m", off=0.0, low=0.0, high=6.0, typical=0.1, scale="torque"),
        Parameter("speed", "rad/s", off=0.1, low=0.005, high=1.0, typical=0.1, shape=True),
    )
    symptom = "stick-slip: the joint breaks loose with a jerk, and moves more easily once it moves"
    reveals = "very slow ramps and tiny steps, together with fast motion"
    confused_with = ("coulomb_friction", "direction_dependent_friction", "load_friction", "hysteresis")
    generalises = ("coulomb_friction",)

    @staticmethod
    def friction(joint, p):
        """Torque (B, n) in N m; Stribeck's curve with a Gaussian decay (Armstrong-Helouvry et al. 1994, eq. 12)."""
        torque = p.sliding + p.extra_static * np.exp(-((joint.velocity / p.speed) ** 2))
        return torque, torque
