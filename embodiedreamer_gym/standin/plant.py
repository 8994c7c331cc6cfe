"""A URDF as a MuJoCo model with a fixed base and one servo per joint; contacts and limits only with added objects."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import MissingExtraError, ModelError

Array = np.ndarray
Gear = tuple[float, float, float]  # compliance, rad/(N m), settling time, s, gap, rad
HARD = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp: the highest impedance that MuJoCo accepts, at any distance


def import_mujoco() -> Any:
    """The mujoco module.

    Raises: MissingExtraError when MuJoCo cannot be imported.
    """
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("the stand-in robot needs MuJoCo; run: pip install 'mujoco>=3.3,<5'") from error
    return mujoco


@dataclass(frozen=True, eq=False)
class Plant:
    """A compiled model and the indices of its joints.

    position, dof (n,): indices in MuJoCo's qpos and qvel; motor_position, motor_dof: those of the motor, which the
    servo drives and the encoder measures (it differs from the joint if the gear has compliance or a gap); arm_root:
    first moving body of each arm; followers: (joint's number, index in qpos, index in qvel, multiplier, offset) of each
    mimic joint.
    """

    model: Any
    position: Array
    dof: Array
    motor_position: Array
    motor_dof: Array
    arm_root: Array
    followers: tuple[tuple[int, int, int, float, float], ...]

    def pose(self, q: Array) -> Array:
        """MuJoCo's qpos for joint positions q (n,), including mimic joints; loose objects have their initial poses."""
        full = self.model.qpos0.copy()
        full[self.position] = full[self.motor_position] = q
        for joint, place, _, multiplier, offset in self.followers:
            full[place] = offset + multiplier * q[joint]
        return full

    def weight(self) -> Callable[[Array], Array]:
        """A function of joint positions (n,): torque (n,) that holds the arm still there."""
        mujoco = import_mujoco()
        data, force = mujoco.MjData(self.model), np.zeros(self.model.nv)

        def weigh(q: Array) -> Array:
            data.qpos[:] = self.pose(q)
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
            mujoco.mj_rne(self.model, data, 0, force)
            return self.load(force)

        return weigh

    def load(self, force: Array) -> Array:
        """Generalised force (nv,) at the joints (n,), including that of their mimic joints."""
        out = force[self.dof].copy()
        for joint, _, dof, multiplier, _ in self.followers:
            out[joint] += multiplier * force[dof]
        return out


def end_effectors(root: ElementTree.Element, joints: Sequence[str]) -> tuple[str, ...]:
    """Links without children that are fixed to a moving link; if there are none, the last joint's link."""
    parents = {_link(j, "parent") for j in root.iter("joint")}
    moving = {_link(j, "child") for j in root.iter("joint") if j.get("type") != "fixed"}
    tips = tuple(
        _link(j, "child")
        for j in root.iter("joint")
        if j.get("type") == "fixed" and _link(j, "child") not in parents and _link(j, "parent") in moving
    )
    if tips:
        return tips
    return tuple(_link(j, "child") for j in root.iter("joint") if j.get("name") == joints[-1])


def disturb_links(root: ElementTree.Element, mass_error: float, com_error: float, rng: np.random.Generator) -> None:
    """Scale each link's mass and inertia by 1 +- mass_error, shift its centre by +- com_error m per axis."""
    for inertial in root.iter("inertial"):
        factor, shift = 1 + mass_error * rng.uniform(-1, 1), com_error * rng.uniform(-1, 1, 3)
        for element in (inertial.find("mass"), inertial.find("inertia")):
            if element is not None:
                element.attrib.update({k: repr(float(v) * factor) for k, v in element.attrib.items()})
        origin = inertial.find("origin")
        if origin is None:
            origin = ElementTree.SubElement(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
        centre = np.array(origin.get("xyz", "0 0 0").split(), float) + shift
        origin.set("xyz", " ".join(repr(float(v)) for v in centre))


def add_payload(root: ElementTree.Element, link: str, mass: float, com: Array) -> None:
    """Weld a small ball (mass kg, radius 1 mm) to a link, its centre at com (3,) m of the link's frame.

    Raises: ModelError when the URDF has no such link.
    """
    if not any(e.get("name") == link for e in root.iter("link")):
        raise ModelError(f"the URDF has no link '{link}' to carry a payload.")
    name, moment = f"payload_on_{link}", repr(0.4e-6 * float(mass))
    body = ElementTree.SubElement(ElementTree.SubElement(root, "link", name=name), "inertial")
    ElementTree.SubElement(body, "mass", value=repr(float(mass)))
    ElementTree.SubElement(body, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")
    joint = ElementTree.SubElement(root, "joint", name=f"{name}_weld", type="fixed")
    ElementTree.SubElement(joint, "parent", link=link)
    ElementTree.SubElement(joint, "child", link=name)
    ElementTree.SubElement(joint, "origin", xyz=" ".join(repr(float(v)) for v in com), rpy="0 0 0")


def build_plant(
    root: ElementTree.Element,
    joints: Sequence[str],
    timestep: float,
    gears: Mapping[str, Gear] | None = None,
    furnish: Callable[[Any], None] | None = None,
) -> Plant:
    """Compile the URDF; joints that are neither listed nor mimic a listed one are fixed.

    A mimic joint follows by an equality constraint with a time constant of two steps, the stiffest that
    MuJoCo accepts. gears: of joints whose motor is a separate body. furnish: adds objects with contacts to the model's
    specification; links then keep their collision shapes, joints their limits, and each link is a body.

    Raises: ModelError when a listed joint is missing or MuJoCo cannot read the URDF.
    """
    mujoco, gears = import_mujoco(), gears or {}
    mimics = _simplify(root, joints, furnish is not None)
    for name in gears:
        _add_rotor(root, name)
    motors = [_rotor(name) if name in gears else name for name in joints]
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read the URDF: {error}.") from error
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _connect(spec, dict(zip(joints, motors, strict=True)), mimics, timestep)
    if furnish is not None:
        spec.compiler.fusestatic = False
        furnish(spec)
    model = spec.compile()
    _clear(model, timestep, contacts=furnish is not None)
    for name, gear in gears.items():
        _mesh(model, name, gear, timestep)
    index, driven = (np.array([model.joint(name).id for name in names]) for names in (joints, motors))
    dof = model.jnt_dofadr[index]
    trees, roots = [], []
    for tree in model.dof_treeid[dof]:
        if tree not in trees:
            trees.append(tree)
            roots.append(model.dof_bodyid[np.flatnonzero(model.dof_treeid == tree)[0]])
    followers = []
    for name, (leader, multiplier, offset) in mimics.items():
        joint = model.joint(name)
        place = int(joint.qposadr[0]), int(joint.dofadr[0])
        followers.append((list(joints).index(leader), *place, multiplier, offset))
    motor = model.jnt_qposadr[driven], model.jnt_dofadr[driven]
    return Plant(model, model.jnt_qposadr[index], dof, *motor, np.array(roots), tuple(followers))


def _connect(
    spec: Any, motors: Mapping[str, str], mimics: Mapping[str, tuple[str, float, float]], timestep: float
) -> None:
    """Add a servo to each joint's motor, a tendon between a separate motor and its joint, and ties of mimic joints."""
    mujoco = import_mujoco()
    for name, target in motors.items():
        motor = spec.add_actuator(name=name, target=target, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.forcerange = (-1e9, 1e9)
    for follower, (leader, multiplier, offset) in mimics.items():
        tie = spec.add_equality(name=follower, type=mujoco.mjtEq.mjEQ_JOINT, name1=follower, name2=leader)
        tie.data[:5] = (offset, multiplier, 0, 0, 0)
        tie.solref, tie.solimp = (2 * timestep, 1.0), HARD
    for name, target in motors.items():
        if target != name:
            tendon = spec.add_tendon(name=name)
            tendon.wrap_joint(target, 1.0)
            tendon.wrap_joint(name, -1.0)


def _rotor(joint: str) -> str:
    return f"{joint}_rotor"


def _add_rotor(root: ElementTree.Element, name: str) -> None:
    """Add a nearly massless link on a copy of a joint; the copy's armature will be the rotor."""
    joint = next(j for j in root.iter("joint") if j.get("name") == name)
    twin = copy.deepcopy(joint)
    child = twin.find("child")
    if child is not None:
        child.set("link", f"{_rotor(name)}_link")
    twin.set("name", _rotor(name))
    root.append(twin)
    body = ElementTree.SubElement(ElementTree.SubElement(root, "link", name=f"{_rotor(name)}_link"), "inertial")
    ElementTree.SubElement(body, "mass", value="1e-9")
    ElementTree.SubElement(body, "inertia", ixx="1e-12", iyy="1e-12", izz="1e-12", ixy="0", ixz="0", iyz="0")


def _mesh(model: Any, name: str, gear: Gear, timestep: float) -> None:
    """Make a tendon a spring outside the gap or, without compliance, a hard limit at its ends.

    The engine adds the spring's damper. A tendon's own damper would slow rotor and joint down, because MuJoCo's
    implicit integrator leaves out the coupling between two branches of a tree.
    """
    compliance, _, gap = gear
    i = model.tendon(name).id
    if compliance > 0:
        model.tendon_stiffness[i], model.tendon_lengthspring[i] = 1 / compliance, (-gap / 2, gap / 2)
    else:
        model.tendon_limited[i], model.tendon_range[i] = 1, (-gap / 2, gap / 2)
        model.tendon_solref_lim[i], model.tendon_solimp_lim[i] = (2 * timestep, 1.0), HARD


def _clear(model: Any, timestep: float, contacts: bool) -> None:
    """Remove the URDF's torque limits and friction, and without contacts its joint limits; make friction hard."""
    if not contacts:
        model.opt.disableflags |= int(import_mujoco().mjtDisableBit.mjDSBL_CONTACT)
        model.jnt_limited[:] = 0
    model.jnt_actfrclimited[:] = 0
    model.dof_damping[:], model.dof_frictionloss[:], model.jnt_stiffness[:] = 0.0, 0.0, 0.0
    model.dof_solref[:], model.dof_solimp[:] = (2 * timestep, 1.0), HARD


def _simplify(root: ElementTree.Element, joints: Sequence[str], touching: bool) -> dict[str, tuple[str, float, float]]:
    """Remove shapes and mimic elements, and fix undriven joints; returns follower -> (leader, multiplier, offset).

    touching: whether to keep collision shapes.
    """
    present = {str(j.get("name")) for j in root.iter("joint")}
    absent = [name for name in joints if name not in present]
    if absent:
        raise ModelError(f"the URDF has no joint {', '.join(absent)}; it has {', '.join(sorted(present))}.")
    for link in root.iter("link"):
        for shape in link.findall("visual") + ([] if touching else link.findall("collision")):
            link.remove(shape)
    mimics = {}
    for joint in root.iter("joint"):
        name, mimic = str(joint.get("name")), joint.find("mimic")
        if mimic is not None:
            joint.remove(mimic)
        if name in joints:
            continue
        if mimic is not None and mimic.get("joint") in joints:
            scale, offset = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
            mimics[name] = (str(mimic.get("joint")), scale, offset)
        else:
            joint.set("type", "fixed")
    return mimics


def _link(joint: ElementTree.Element, role: str) -> str:
    element = joint.find(role)
    return "" if element is None else str(element.get("link"))


def rotation_quaternion(roll: float, pitch: float) -> Array:
    """Quaternion (4,), w first, of Ry(pitch) Rx(roll), which is a URDF rpy without yaw."""
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    return np.array([cr * cp, sr * cp, cr * sp, -sr * sp])


def turned(*quaternions: Array) -> Array:
    """Product (4,) of quaternions (4,), w first."""
    mujoco, product = import_mujoco(), np.array([1.0, 0.0, 0.0, 0.0])
    for factor in quaternions:
        mujoco.mju_mulQuat(product, product.copy(), np.array(factor, float))
    return product
