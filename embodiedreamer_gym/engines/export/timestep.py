"""The time step at which an exported file agrees with the package's own rollouts, and the armature for it."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.engines.export.joints import Joints
from embodiedreamer_gym.simulation.drive import TIME_STEP

STEPS = tuple(TIME_STEP / k for k in (1, 2, 4, 8, 16))
NEEDS = {  # field of Joints -> the longest step, and why
    "limit": (
        TIME_STEP / 16,
        "because MuJoCo clamps a torque by the speed half a step ago, and drops its implicit damping then",
    ),
    "extra_static": (
        TIME_STEP / 16,
        "because the extra friction near standstill is a bristle, the stiffer the shorter the step",
    ),
    "fastest": (TIME_STEP / 8, "because a motor's torque falls with the speed of half a step ago"),
    "lowpass": (TIME_STEP / 8, "because a filter takes each command as held for a step"),
}


def choose_timestep(joints: Joints) -> tuple[float, str]:
    """The longest of STEPS that the joints allow, s, and the reason."""
    bounds = [(STEPS[1], "half a step of `compare`: MuJoCo takes Coriolis forces at the speed of half a step ago")]
    if np.isfinite(joints.rate).any():
        bounds = [(STEPS[0], "the step of `compare`, because its command ramps change slope at its steps")]
    for name, bound in NEEDS.items():
        values = getattr(joints, name)
        if np.any(np.isfinite(values) & (values > 0)):
            bounds.append(bound)
    drag = joints.damping + joints.viscous_friction
    rotor = float(np.min(2 * joints.rotor_inertia / np.maximum(drag, 1e-12)))
    bounds.append((rotor, "at which half a step of damping is no more than the rotor inertia"))
    bounds += [(float(delay), "the shortest delay") for delay in joints.delay[joints.delay > 0]]
    most, reason = min(bounds)
    return next((step for step in STEPS if step <= most * (1 + 1e-9)), STEPS[-1]), reason


def armature(joints: Joints, dt: float) -> np.ndarray:
    """Armature (n,) kg m^2: the rotor inertia minus half a step of damping, not below zero.

    An implicit integrator adds dt (damping + friction) to the inertia; the package computes damping at the mean of the
    old and the new velocity, which adds half of that. A clamped servo adds nothing, and an error of the inertia would
    accumulate meanwhile. So, for joints with a torque limit, the servo's damping is not subtracted.
    """
    damping = np.where(np.isfinite(joints.limit), 0.0, joints.damping)
    return np.maximum(joints.rotor_inertia - 0.5 * dt * (damping + joints.viscous_friction), 0.0)
