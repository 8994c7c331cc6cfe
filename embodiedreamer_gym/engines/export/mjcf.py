"""Writes a calibrated model as an MJCF: bodies, servos as actuators, friction, and the time step that they need."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.export.actuators import add_passive, add_servo, sliding_share
from embodiedreamer_gym.engines.export.effects import MJCF, MJCF_BODIES, conflicts
from embodiedreamer_gym.engines.export.joints import Joints
from embodiedreamer_gym.engines.export.meshes import copy_meshes, mesh_notes
from embodiedreamer_gym.engines.export.parts import Parts, changed_urdf, parts_of, write_xml
from embodiedreamer_gym.engines.export.report import Export, Line, joint_notes
from embodiedreamer_gym.engines.export.timestep import armature, choose_timestep
from embodiedreamer_gym.engines.mujoco.bodies import READABLE, robot_specification
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.data import GRAVITY
from embodiedreamer_gym.robot.tree import WORLD
from embodiedreamer_gym.robot.urdf import resolve_meshes

BRISTLE = 0.1  # stiffness of a bristle, in units of inertia / step^2, so that the step resolves it
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp: rigid, the highest impedance that MuJoCo allows
WXYZ = [3, 0, 1, 2]


def write_mjcf(model: RobotModel, path: Path, timestep: float | None = None) -> Export:
    """Write a model as an MJCF, and its meshes into the folder FILE_meshes beside it.

    timestep: s; None: chosen from the model's effects.
    Raises: ModelError when a file cannot be read or written, or MuJoCo cannot simulate the model.
    """
    parts = parts_of(model, MJCF, MJCF_BODIES, mujoco)
    lost = conflicts(parts.joints)
    parts.written = [line for line in parts.written if line.name not in lost]
    parts.lost += [Line(name, text) for name, text in lost.items()]
    chosen, reason = choose_timestep(parts.joints)
    dt = chosen if timestep is None else timestep
    urdf = changed_urdf(model, parts.mechanics)
    missing = resolve_meshes(urdf, model.urdf, READABLE)
    try:
        spec = _specification(model, urdf, parts, dt)
        spec.compile()
        root = ElementTree.fromstring(spec.to_xml())
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot simulate the robot {model.name}: {error}.") from error
    copied = copy_meshes([str(mesh.get("file")) for mesh in root.iter("mesh")], model.urdf.parent, path)
    for mesh in root.iter("mesh"):
        mesh.set("file", copied[str(mesh.get("file"))])
    notes = (
        f"The time step is {1e3 * dt:g} ms" + (f", {reason}." if timestep is None else " as requested."),
        *_step_notes(parts.joints, dt),
        *mesh_notes(copied, missing, path),
        "Links of the robot do not touch each other, and the URDF's effort limits are not applied, as in `compare`.",
        *joint_notes(model),
    )
    written = (Line("servo", "actuator: gainprm, biasprm"), Line("rotor inertia", "joint: armature"),
               Line("viscous friction", "joint: damping"), *parts.written)  # fmt: skip
    export = Export(model.name, "mjcf", path, written, tuple(parts.lost), notes, dt)
    write_xml(root, export.comment, path)
    return export


def _specification(model: RobotModel, urdf: ElementTree.Element, parts: Parts, dt: float) -> Any:
    """A MuJoCo specification of a URDF's bodies, with the joints, servos and gravity of a model's parts."""
    spec = robot_specification(model, urdf)
    spec.compiler.inertiafromgeom = 0  # masses are those of the inertial elements
    spec.option.timestep = dt
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _set_gravity(spec, model, parts.mechanics.gravity[0])
    for geom in spec.geoms:
        if geom.contype:  # links touch other bodies, but not each other
            geom.contype, geom.conaffinity = 1, 0
    _set_joints(spec, model, parts, dt)
    for i, name in enumerate(model.joints):
        add_servo(spec, name, parts.joints, i, dt)
    for i, name in enumerate(model.joints):  # after the servos, whose order is that of the joints
        inertia = (model.inertia_scale[i] + model.rotor_inertia[i]) / parts.gain[i] ** 2
        add_passive(spec, name, parts.joints, i, BRISTLE * inertia / dt**2)
    return spec


def _set_gravity(spec: Any, model: RobotModel, gravity: np.ndarray) -> None:
    """Set gravity (arms, 3); if it differs between arms, rotate each arm's first moving body instead."""
    tree = model.tree
    if np.allclose(gravity, gravity[0]):
        spec.option.gravity = gravity[0]
        return
    for body in np.flatnonzero(tree.parent == WORLD):
        felt = gravity[tree.arm[tree.coordinate[body]]]
        mount = Rotation.from_matrix(tree.rotation[body])
        tilt = Rotation.align_vectors(GRAVITY[None], felt[None])[0]
        turned = spec.joint(tree.joint_names[body]).parent
        here = Rotation.from_quat(np.roll(np.array(turned.quat), -1))
        turned.quat = (here * mount.inv() * tilt * mount).as_quat()[WXYZ]


def _set_joints(spec: Any, model: RobotModel, parts: Parts, dt: float) -> None:
    """Set the driven joints, and couple the joints that follow them with stiff equality constraints."""
    tree, joints, inertia = model.tree, parts.joints, armature(parts.joints, dt)
    stiff = [2 * dt, 1.0]
    for k, name in enumerate(tree.joint_names):
        joint, i = spec.joint(name), int(tree.coordinate[k])
        joint.actfrclimited, joint.actfrcrange, joint.frictionloss, joint.armature = 0, [0.0, 0.0], 0.0, 0.0
        joint.solref_limit, joint.solimp_limit = stiff, STIFF
        if k != parts.bodies[i]:
            ratio = tree.gain[k] / parts.gain[i]
            joint.limited, joint.damping, joint.stiffness = 0, _polynomial(0.0), _polynomial(0.0)
            equality = spec.add_equality()
            equality.type, equality.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
            equality.name1, equality.name2 = name, model.joints[i]
            equality.data[:2] = [tree.offset[k] - ratio * parts.zero[i], ratio]
            equality.solref, equality.solimp = stiff, STIFF
            continue
        joint.armature = inertia[i]
        joint.damping = _polynomial(joints.viscous_friction[i], joints.drag[i])
        joint.stiffness, joint.springref = _polynomial(joints.spring[i]), joints.spring_angle[i] + joints.offset[i]
        rigid = joints.dry_friction[i] - sliding_share(joints)[i]
        if rigid > 0:
            joint.frictionloss, joint.solref_friction, joint.solimp_friction = rigid, stiff, STIFF
        joint.ref = joints.offset[i]
        ends = np.sort(parts.gain[i] * np.array([tree.lower[i], tree.upper[i]]) + parts.zero[i])
        joint.limited = int(np.isfinite(ends).all())
        joint.range = ends + joints.offset[i] if joint.limited else [0.0, 0.0]


def _polynomial(*coefficients: float) -> Any:
    """Coefficients of a damping or stiffness; older versions of MuJoCo take a single number."""
    whole = [*coefficients, *[0.0] * (3 - len(coefficients))]
    return whole if hasattr(mujoco, "mjNPOLY") else whole[0]


def _step_notes(joints: Joints, dt: float) -> list[str]:
    """Notes on values that depend on the time step and are wrong at another one."""
    half = 0.5 * dt * (joints.damping + joints.viscous_friction)
    notes = ["The armature is the rotor inertia minus half a step of damping, since the integrator adds a whole step "
             "of it; with another time step, export again."]  # fmt: skip
    if np.any(half > joints.rotor_inertia * (1 + 1e-9)):
        notes.append(
            "Half a step of damping is more than the rotor inertia of a joint, which moves as if it were heavier."
        )
    if joints.lowpass.any():
        notes.append(
            "dynprm is a time constant, chosen so that a command that is held for a step lags as much as in the "
            "controller's filter."
        )
    if np.any((joints.delay > 0) & (joints.delay < dt)):
        notes.append("A delay that is shorter than the time step is left out.")
    if joints.delay.any():
        notes.append(
            "MuJoCo's delay lines begin at zero: call mj_initCtrlHistory with the first command before the first step."
        )
    return notes
