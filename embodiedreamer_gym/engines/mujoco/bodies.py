"""A robot model's bodies in MuJoCo."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np

from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.engines.plant import rotor_shares
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf import read_xml, resolve_meshes

READABLE = (".stl", ".obj", ".msh")  # meshes that MuJoCo reads
FASTEST = np.repeat([20.0, 100.0], 3)  # m/s, rad/s, of a free body; a faster spin diverges in explicit integration


class MujocoBodies:
    """The arms of a robot model in a MuJoCo world; the joints' armature is the rotors' inertia.

    model, data: MuJoCo's.
    position, velocity, force: of the joints (k,), as views of MuJoCo's memory.
    """

    def __init__(self, robot: RobotModel, dt: float, furnish: Callable[[Any], None]) -> None:
        spec = robot_specification(robot)
        spec.option.timestep = dt
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        furnish(spec)
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise ModelError(f"MuJoCo cannot simulate the robot {robot.name}: {error}.") from error
        self.data = mujoco.MjData(self.model)
        names = robot.tree.joint_names
        joints = np.array([self.model.joint(name).id for name in names])
        dofs = self.model.jnt_dofadr[joints]
        self.order, used = np.argsort(dofs), slice(0, len(names))  # the robot's joints are first, then free bodies
        self._free = self.data.qvel[len(names) :].reshape(-1, len(FASTEST))
        self.position, self.velocity = self.data.qpos[used], self.data.qvel[used]
        self.force = self.data.qfrc_applied[used]
        self.mechanics = robot.nominal_mechanics
        self.armature = rotor_shares(robot)
        self.model.dof_damping[dofs], self.model.dof_frictionloss[dofs] = 0.0, 0.0
        self.model.dof_armature[dofs] = self.armature
        self.model.jnt_stiffness[joints], self.model.jnt_actfrclimited[joints] = 0.0, 0

    def place(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set joint positions and velocities (k,)."""
        self.position[:], self.velocity[:] = position, velocity

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities (k,)."""
        return self.position, self.velocity

    def advance(self) -> None:
        """Take one physics step under the joint forces."""
        mujoco.mj_step(self.model, self.data)
        np.maximum(np.minimum(self._free, FASTEST, out=self._free), -FASTEST, out=self._free)


def robot_specification(robot: RobotModel, root: ElementTree.Element | None = None) -> Any:
    """A robot's URDF as a MuJoCo specification: each link is a body; joints that the model does not drive are fixed.

    root: XML of another URDF to use instead, with meshes in the same place. Links without a visual are drawn with their
    collision shapes; meshes that are missing, or of a format that MuJoCo cannot read, are left out.
    Raises: ModelError when MuJoCo cannot read the URDF.
    """
    root = read_xml(robot.urdf) if root is None else root
    driven = set(robot.tree.joint_names)
    for joint in root.iter("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
        if joint.get("name") not in driven:
            joint.set("type", "fixed")
    resolve_meshes(root, robot.urdf, READABLE)
    for link in root.iter("link"):
        if link.find("visual") is None:
            for shape in link.findall("collision"):
                drawn = copy.deepcopy(shape)
                drawn.tag = "visual"
                link.append(drawn)
    options = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(options, "compiler", discardvisual="false", fusestatic="false", strippath="false")
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read the URDF {robot.urdf}: {error}.") from error
    spec.compiler.fusestatic = False
    return spec
