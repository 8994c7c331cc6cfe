"""The actuators of an MJCF: a servo for each joint, and motors without input for passive effects on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from embodiedreamer_gym.engines.export.joints import Joints
from embodiedreamer_gym.engines.mujoco.library import mujoco

LEAST = 0.05  # share of Stribeck's extra friction that its bristle keeps at any speed
POSITION, PASSIVE = 1, 16  # inputs of an actuator, mjtCtrlInput


def add_servo(spec: Any, name: str, joints: Joints, i: int, dt: float) -> None:
    """Add a joint's servo: force = stiffness (command - position) - damping velocity + bias, within its limits."""
    servo = spec.add_actuator()
    servo.name, servo.target, servo.trntype = name, name, mujoco.mjtTrn.mjTRN_JOINT
    stiffness, damping, bias, limit = joints.stiffness[i], joints.damping[i], joints.bias[i], joints.limit[i]
    ramps, delay, constant = np.isfinite(joints.rate[i]), joints.delay[i], joints.lowpass[i]
    rate = joints.rate[i] if ramps else 0.0
    if np.isfinite(joints.fastest[i]):
        strength = np.sqrt(joints.stall[i] / joints.fastest[i])  # of a motor of one ohm, N m/A
        control = [stiffness, 0.0, damping, rate, 0.0, strength * joints.fastest[i]]  # and its highest voltage
        servo.set_to_dcmotor(motorconst=[strength] * 2, resistance=1.0, controller=control, ctrlspec=POSITION)
        bias = 0.0  # `add_passive` adds it
    else:
        if ramps:
            servo.set_to_pid(kp=stiffness, kv=damping, slewmax=rate, ctrlspec=POSITION)
        servo.gainprm[0] = 0.0 if ramps else stiffness
        servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        servo.biasprm[:3] = [bias, -stiffness, -damping]
    if np.isfinite(limit):
        servo.forcelimited, servo.forcerange = 1, [bias - limit, bias + limit]
    if constant > 0:
        servo.dyntype, servo.actearly = mujoco.mjtDyn.mjDYN_FILTEREXACT, 1
        servo.dynprm[0] = filter_constant(constant, dt)
    if delay >= dt:
        servo.delay, servo.nsample, servo.interp = delay, int(np.ceil(delay / dt - 1e-9)) + 1, 1


def add_passive(spec: Any, name: str, joints: Joints, i: int, stiffest: float) -> None:
    """Add motors without input: bristles of LuGre's friction model, cogging, and the bias of a servo that is a motor.

    stiffest: of bristles, N m/rad.
    """
    least = sliding_share(joints)[i]
    constant = joints.bias[i] if np.isfinite(joints.fastest[i]) else 0.0
    level, phase = joints.hysteresis[i], joints.ripple_phase[i] - joints.ripple_frequency[i] * joints.offset[i]
    kinds = {  # the motor's law and its numbers; the first number is zero if the effect is absent
        "bias": ("cogging", [constant, 0.0, 0.5 * np.pi]),
        "ripple": ("cogging", [joints.ripple[i], joints.ripple_frequency[i], phase]),
        "hysteresis": ("lugre", [level / max(joints.travel[i], 1e-9), 0.0, level, level, 1.0]),
        "stribeck": ("lugre", [stiffest if least > 0 else 0.0, 0.0, least, least + joints.extra_static[i], joints.stribeck_speed[i]]),
    }  # fmt: skip
    for kind, (law, numbers) in kinds.items():
        if numbers[0]:
            one = spec.add_actuator()
            one.name, one.target, one.trntype = f"{name}_{kind}", name, mujoco.mjtTrn.mjTRN_JOINT
            one.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=PASSIVE, **{law: numbers})


def sliding_share(joints: Joints) -> np.ndarray:
    """Dry friction (n,) that Stribeck's bristles keep at any speed; it is not zero, as their law divides by it."""
    return np.clip(
        LEAST * joints.extra_static,
        1e-3 * joints.extra_static,
        np.maximum(joints.dry_friction, 1e-3 * joints.extra_static),
    )


def filter_constant(constant: float, dt: float) -> float:
    """Time constant, s, with which a filter that holds each command for a step lags behind a ramp by `constant`."""
    return dt / float(np.log1p(dt / constant))
