"""Export of each effect: one function per effect, and one table per format.

A function changes the joints' numbers with the effect's parameters (n,), and returns what the format loses, if
anything. Changes of mechanics need no function: the changed masses are written, if the format has a place for them.
Other effects are listed as not exported, with their symptom.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from embodiedreamer_gym.engines.export.joints import Joints


class Entry(NamedTuple):
    """An effect in a format.

    write: changes the joints, returns what is lost.
    place: where it is in the file.
    needs: attribute that the mujoco module must have.
    otherwise: entry for older versions without it.
    """

    write: Callable[[Joints, SimpleNamespace], str | None]
    place: str
    needs: str = ""
    otherwise: Entry | None = None


def command_delay(joints: Joints, p: SimpleNamespace) -> None:
    """A delay of the actuator's input."""
    joints.delay = joints.delay + p.seconds


def command_lowpass(joints: Joints, p: SimpleNamespace) -> None:
    """A filter of the actuator's input."""
    joints.lowpass = joints.lowpass + p.time_constant


def command_rate_limit(joints: Joints, p: SimpleNamespace) -> None:
    """A ramp of the actuator's input."""
    joints.rate = np.minimum(joints.rate, p.rate)


def torque_saturation(joints: Joints, p: SimpleNamespace) -> None:
    """A limit of the torque."""
    joints.limit = np.minimum(joints.limit, p.limit)


def torque_constant(joints: Joints, p: SimpleNamespace) -> None:
    """A factor of the servo's gains and limits."""
    joints.gain = joints.gain * p.gain


def voltage_limit(joints: Joints, p: SimpleNamespace) -> str | None:
    """A motor with limited voltage, whose torque falls equally in both directions."""
    joints.stall, joints.forward, joints.backward = p.stall_torque, p.forward, p.backward
    if np.allclose(p.forward, p.backward, rtol=0.01):
        return None
    each = ", ".join(f"{a:.3g} and {b:.3g}" for a, b in zip(p.forward, p.backward, strict=True))
    return f"the difference between the directions: both get the mean slope (highest speeds {each} rad/s)"


def speed_limit(joints: Joints, p: SimpleNamespace) -> str:
    """The highest speed; the torque at rest becomes the torque limit."""
    joints.forward, joints.backward = p.forward, p.backward
    joints.limit = np.minimum(joints.limit, p.stall_torque)
    return "the fall of the torque on the way to the highest speed: fast moves are too fast"


def coulomb_friction(joints: Joints, p: SimpleNamespace) -> None:
    """Dry friction."""
    joints.dry_friction = joints.dry_friction + p.torque


def direction_dependent_friction(joints: Joints, p: SimpleNamespace) -> None:
    """The mean of both directions as dry friction, and half the difference as a constant torque; the sum is exact."""
    joints.dry_friction = joints.dry_friction + 0.5 * (p.forward + p.backward)
    joints.bias = joints.bias + 0.5 * (p.backward - p.forward)


def sliding_friction(joints: Joints, p: SimpleNamespace) -> str:
    """Stribeck's sliding level."""
    joints.dry_friction = joints.dry_friction + p.sliding
    return f"the extra friction near standstill, up to {p.extra_static.max():.3g} N m: slow moves stick less than the robot"


def stribeck_friction(joints: Joints, p: SimpleNamespace) -> None:
    """The sliding level as dry friction, which stays rigid, and a bristle for the extra level near standstill."""
    joints.dry_friction = joints.dry_friction + p.sliding
    joints.extra_static, joints.stribeck_speed = p.extra_static, p.speed


def hysteresis(joints: Joints, p: SimpleNamespace) -> None:
    """A bristle with one level: Dahl's law is LuGre's without the falling curve and the damper."""
    joints.hysteresis, joints.travel = p.torque, p.travel


def torque_ripple(joints: Joints, p: SimpleNamespace) -> None:
    """A motor's cogging."""
    joints.ripple, joints.ripple_frequency, joints.ripple_phase = p.amplitude, p.frequency, p.phase


def quadratic_drag(joints: Joints, p: SimpleNamespace) -> None:
    """Damping proportional to the speed."""
    joints.drag = joints.drag + p.coefficient


def torque_bias(joints: Joints, p: SimpleNamespace) -> None:
    """A constant torque."""
    joints.bias = joints.bias + p.torque


def joint_spring(joints: Joints, p: SimpleNamespace) -> None:
    """A spring of the joint."""
    joints.spring, joints.spring_angle = joints.spring + p.stiffness, p.angle


def encoder_offset(joints: Joints, p: SimpleNamespace) -> None:
    """An offset of the joint's value."""
    joints.offset = joints.offset + p.angle


MOTORS = "mjtCtrlInput.mjINPUT_NONE"  # motors with selectable inputs, or without

MJCF: Mapping[str, Entry] = {
    "command_delay": Entry(command_delay, "actuator: delay, nsample", "MjsActuator.delay"),
    "command_lowpass": Entry(command_lowpass, "actuator: dyntype filterexact, actearly"),
    "command_rate_limit": Entry(command_rate_limit, "actuator: dyntype pid, slewmax", "mjtDyn.mjDYN_PID"),
    "torque_saturation": Entry(torque_saturation, "actuator: forcerange"),
    "voltage_limit": Entry(
        voltage_limit,
        "actuator: dcmotor",
        MOTORS,
        Entry(speed_limit, "actuator: forcerange (torque at rest)"),
    ),
    "torque_constant": Entry(torque_constant, "actuator: gainprm, biasprm, forcerange"),
    "coulomb_friction": Entry(coulomb_friction, "joint: frictionloss"),
    "stribeck_friction": Entry(
        stribeck_friction,
        "joint: frictionloss; passive dcmotor: lugre",
        MOTORS,
        Entry(sliding_friction, "joint: frictionloss"),
    ),
    "hysteresis": Entry(hysteresis, "passive dcmotor: lugre", MOTORS),
    "torque_ripple": Entry(torque_ripple, "passive dcmotor: cogging", MOTORS),
    "direction_dependent_friction": Entry(direction_dependent_friction, "joint: frictionloss; actuator: biasprm"),
    "quadratic_drag": Entry(quadratic_drag, "joint: second coefficient of damping", "mjNPOLY"),
    "torque_bias": Entry(torque_bias, "actuator: biasprm, forcerange"),
    "joint_spring": Entry(joint_spring, "joint: stiffness, springref"),
    "encoder_offset": Entry(encoder_offset, "joint: ref"),
}
MJCF_BODIES: Mapping[str, str] = {
    "mass": "body: inertial", "first_moment": "body: inertial", "inertia": "body: inertial", "rotor_inertia": "joint: armature",
    "gravity": "option: gravity, or the body's quat",
}  # fmt: skip


def conflicts(joints: Joints) -> dict[str, str]:
    """Remove effects from the joints that an actuator cannot combine with others; returns what is lost with each."""
    lost = {}
    line, ramp, filtered = np.isfinite(joints.fastest), np.isfinite(joints.rate), joints.lowpass > 0
    if np.any(filtered & (line | ramp)):
        joints.lowpass = np.where(line | ramp, 0.0, joints.lowpass)
        lost["command_lowpass"] = (
            "an actuator that ramps its input or is a motor cannot filter it; filter the commands that you send"
        )
    return lost


URDF: Mapping[str, Entry] = {
    "torque_saturation": Entry(torque_saturation, "limit: effort"),
    "voltage_limit": Entry(speed_limit, "limit: velocity, effort (torque at rest)"),
    "coulomb_friction": Entry(coulomb_friction, "dynamics: friction"),
    "stribeck_friction": Entry(sliding_friction, "dynamics: friction"),
}
URDF_BODIES: Mapping[str, str] = dict.fromkeys(("mass", "first_moment", "inertia"), "inertial")
