"""The true robot in MuJoCo: its parameters, their MJCF, and the indices of its joints in MuJoCo's arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import mujoco
import numpy as np

from benchmarks.independent.arms import Arm

STEP = 0.0005  # s, time step of the physics
RATIO = 0.7  # damping ratio at home
VISCOUS = 0.2  # share of the damping that is friction; the servo gives the rest


@dataclass(frozen=True)
class Robot:
    """Parameters of one robot; arrays (n,) or (n, 3), SI units.

    payload: mass and position in the tip's frame. springs: joint -> stiffness and damping of its gear. gaps: joint ->
    total free play. With either, servo and encoder are on the motor's side.
    """

    arm: Arm
    mass: np.ndarray
    centre: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    viscous: np.ndarray
    rotor: np.ndarray
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    payload: tuple[float, np.ndarray] | None = None
    springs: dict[int, tuple[float, float]] = field(default_factory=dict)
    gaps: dict[int, float] = field(default_factory=dict)


@cache
def nominal(arm: Arm) -> Robot:
    """The robot according to its manufacturer; the gains give each joint its frequency and damping at home."""
    zero = np.zeros(len(arm.joints))
    bare = Robot(arm, arm.each("mass"), arm.each("centre"), zero, zero, zero, arm.each("rotor"))
    inertia = np.diag(mass_matrix(Plant(bare)))
    rate = 2 * np.pi * arm.each("hertz")
    damping = 2 * RATIO * inertia * rate
    gains = {"stiffness": inertia * rate**2, "damping": (1 - VISCOUS) * damping, "viscous": VISCOUS * damping}
    return replace(bare, **{key: np.array([float(f"{x:.3g}") for x in value]) for key, value in gains.items()})


@cache
def usual_torque(arm: Arm) -> np.ndarray:
    """Torque of each joint in ordinary motion, (n,), N m: gravity at home plus inertia times 10 rad/s^2."""
    plant = Plant(nominal(arm))
    inertia = np.diag(mass_matrix(plant))
    return np.abs(plant.data.qfrc_bias[plant.motor]) + 10 * inertia


def mass_matrix(plant: Plant) -> np.ndarray:
    """The mass matrix at home, (n, n)."""
    plant.data.qpos[:] = 0
    plant.data.qpos[plant.motor] = plant.robot.arm.each("home")
    mujoco.mj_forward(plant.model, plant.data)
    columns, n = [], plant.model.nv
    for k in plant.motor:
        column = np.zeros(n)
        mujoco.mj_mulM(plant.model, plant.data, column, np.eye(n)[k])
        columns.append(column[plant.motor])
    return np.array(columns)


def mjcf(robot: Robot) -> str:
    """The robot as MJCF; a joint with an elastic gear or free play is a rotor and a second hinge after it."""
    arm, lines = robot.arm, []
    for j, joint in enumerate(arm.joints):
        axis = f'axis="{_text(joint.axis)}"'
        lines.append(f'<body pos="{_text(joint.at)}">')
        lines.append(
            f'<joint name="{joint.name}" {axis} armature="{robot.rotor[j]:.9g}" damping="{robot.viscous[j]:.9g}"/>'
        )
        if j in robot.springs or j in robot.gaps:
            lines.append('<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/><body>')
            lines.append(f'<joint name="{joint.name}_gear" {axis} {_gear(robot, j)}/>')
        inertia = joint.inertia * robot.mass[j] / joint.mass
        lines.append(
            f'<inertial pos="{_text(robot.centre[j])}" mass="{robot.mass[j]:.9g}" diaginertia="{_text(inertia)}"/>'
        )
    lines.append(f'<body name="tip" pos="{_text(arm.tip)}">')
    if robot.payload is not None:
        mass, at = robot.payload
        ball = 0.4 * mass * (mass / (4.19 * 7850)) ** (2 / 3)  # kg m^2, of a steel ball
        lines.append(f'<inertial pos="{_text(at)}" mass="{mass:.9g}" diaginertia="{_text([ball] * 3)}"/>')
    else:
        lines.append('<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>')
    lines += ["</body>"] * (1 + len(arm.joints) + len({*robot.springs, *robot.gaps}))
    return (
        '<mujoco><compiler angle="radian"/>'
        f'<option timestep="{STEP}" integrator="implicitfast" gravity="{_text(robot.gravity)}"/>'
        '<default><joint solreffriction="0.002 1" solimpfriction="0.99 0.999 0.001" solreflimit="0.002 1"/></default>'
        f"<worldbody>{''.join(lines)}</worldbody></mujoco>"
    )


def _gear(robot: Robot, j: int) -> str:
    if j in robot.springs:
        stiffness, damping = robot.springs[j]
        return f'stiffness="{stiffness:.9g}" damping="{damping:.9g}"'
    half = robot.gaps[j] / 2
    return f'limited="true" range="{-half:.9g} {half:.9g}"'


def _text(numbers: object) -> str:
    return " ".join(f"{number:.9g}" for number in np.asarray(numbers, float))


class Plant:
    """A compiled robot and its state. motor (n,): indices of the joints, on the motor's side, in qpos and qvel."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot))
        self.data = mujoco.MjData(self.model)
        self.motor = np.array([self.model.joint(name).dofadr[0] for name in robot.arm.names])
        self.tip = int(self.model.body("tip").id)

    def tip_place(self) -> np.ndarray:
        """Position of the tip in the base's frame, (3,), m."""
        return np.array(self.data.xpos[self.tip])

    def push_tip(self, force: np.ndarray) -> None:
        """Apply a force (3,), N, to the tip until the next call."""
        across = np.cross(self.data.xpos[self.tip] - self.data.xipos[self.tip], force)
        self.data.xfrc_applied[self.tip] = [*force, *across]
