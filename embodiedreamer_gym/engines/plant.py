"""The robot's plant in a physics engine: the drive used in fits, with the engine's bodies, contacts and clock."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from embodiedreamer_gym.effects import Mechanics
from embodiedreamer_gym.engines.linkage import joint_forces, read_joints
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.dynamics import ONE
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive, Sets
from embodiedreamer_gym.simulation.rollout import (
    Rollout,
    Sampler,
    check_names,
    command_rule,
    first_state,
    plant_commands,
)

LINKAGE = 60.0  # rad/s: natural frequency of the springs between joints that move together (fingers of a gripper)


class Bodies(Protocol):
    """The k moving bodies of a robot in an engine, in the engine's order.

    order: (k,) the tree's bodies in the engine's order.
    force: (k,) forces on the joints in the next step, N m or N.
    mechanics: masses and inertias that the engine simulates, a batch of one.
    armature: (k,) rotor inertia in addition to them, in the tree's order, kg m^2 or kg.
    """

    order: np.ndarray
    force: np.ndarray
    mechanics: Mechanics
    armature: np.ndarray

    def place(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set joint positions and velocities (k,)."""
        ...

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities (k,)."""
        ...

    def advance(self) -> None:
        """Take one physics step under the joint forces."""
        ...


class Plant:
    """A robot model whose bodies an engine moves, under torque control.

    Each step applies the joint torques that give the engine's bodies the acceleration of the model's drive (by inverse
    dynamics of the engine's own masses). This includes the effects of payload, tilt and rotor inertia. Joints moved by
    one coordinate get the same acceleration; a spring and a damper hold them together in contact.
    """

    def __init__(self, model: RobotModel, bodies: Bodies, dt: float = TIME_STEP) -> None:
        self.model, self.dt, self._bodies = model, dt, bodies
        self._matrices = self._linkage()
        self._shape = 2, 1, model.n  # of positions and velocities
        self._linked = np.empty(model.tree.bodies)  # forces that hold linked joints together
        rigid, masses = model.bodies, model.bodies.pack(bodies.mechanics)
        self._rigid = rigid.links, rigid.frames, *masses, bodies.armature * model.tree.gain
        self.drive = Drive(model, dt=dt)

    def _linkage(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices (n + k, k) and a shift (n + k,) for the driven joints and the forces between linked joints.

        With the engine's joints q and speeds v: the first matrix times q, minus the shift, gives the n driven joints
        (the mean of joints that move together) and each body's spring force; the second times v gives their speeds and
        each body's damper force.
        """
        tree, n, k = self.model.tree, self.model.n, self.model.tree.bodies
        count = np.bincount(tree.coordinate, minlength=n)[tree.coordinate]
        mean = np.zeros((n, k))
        mean[tree.coordinate, np.arange(k)] = 1.0 / (tree.gain * count)
        apart = np.eye(k) - tree.gain[:, None] * mean[tree.coordinate]
        weight = np.where(count > 1, self._bodies.mechanics.mass[0] + self._bodies.armature * tree.prismatic, 0.0)
        shift = np.concatenate([mean @ tree.offset, weight * LINKAGE**2 * (apart @ tree.offset)])
        spring, damper = weight[:, None] * LINKAGE**2 * apart, weight[:, None] * 2 * LINKAGE * apart
        columns = self._bodies.order
        springs, dampers = (np.ascontiguousarray(np.vstack([mean, rows])[:, columns]) for rows in (spring, damper))
        return springs, dampers, shift

    def reset(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray, sets: Sets | None = None) -> None:
        """Place the joints at measured positions (n,); internal states are at rest at the first command (n,).

        sets: parameters that replace the model's own from now on, see `Drive`.
        """
        if sets is not None:
            self.drive = Drive(self.model, sets, dt=self.dt)
        self.drive.start(measured[None], velocity[None], command[None])
        tree, order = self.model.tree, self._bodies.order
        q = tree.gain * self.drive.position[0][tree.coordinate] + tree.offset
        v = tree.gain * velocity[tree.coordinate]
        self._bodies.place(q[order], v[order])

    def step(self, command: np.ndarray) -> np.ndarray:
        """Advance by one step under the command (n,); return the acceleration (n,) from the drive."""
        drive, bodies = self.drive, self._bodies
        self._read()
        acceleration = drive.accelerate(command[None])
        motion = drive.position, drive.velocity, acceleration
        joint_forces(ONE, *motion, *self._rigid, self._linked, bodies.order, bodies.force)
        bodies.advance()
        drive.time += self.dt
        return acceleration[0]

    def _read(self) -> None:
        """Copy the engine's joint states to the drive."""
        motion = np.empty(self._shape)
        read_joints(*self._bodies.read(), *self._matrices, motion, self._linked)
        self.drive.position, self.drive.velocity = motion

    @property
    def measured(self) -> np.ndarray:
        """Encoder readings (n,) at the start of the last step, in the joints' units."""
        return self.drive.measured[0]

    def observe(self) -> tuple[np.ndarray, np.ndarray]:
        """Present encoder readings (n,) and joint speeds (n,), without a step."""
        self._read()
        return self.drive.read()[0], self.drive.velocity[0].copy()


def rotor_shares(model: RobotModel) -> np.ndarray:
    """Rotor inertia (k,) of each moving body, kg m^2, or kg for prismatic joints; linked bodies share a rotor."""
    tree = model.tree
    whole = np.bincount(tree.coordinate, tree.gain**2, minlength=model.n)
    return model.rotor_inertia[tree.coordinate] / whole[tree.coordinate]


def replay(plant: Plant, recording: Recording, hold: str | None = None) -> Rollout:
    """Simulate a recording in an engine without feedback from it; arrays (T, n) as `simulate` returns them.

    Raises: SimulationError when the recording is not of this robot or the simulation diverges.
    """
    model, dt = plant.model, plant.dt
    check_names(model, recording)
    if (recording.gain != 1).any():
        plant = Plant(model.with_(stiffness=model.stiffness * recording.gain), plant._bodies, dt)
    commands = plant_commands(recording, hold or command_rule(model, recording), dt)
    track = np.empty((3, len(commands), 1, model.n))
    plant.reset(*first_state(recording), commands[0])
    for k, command in enumerate(commands):
        plant.step(command)
        drive = plant.drive
        track[:, k, 0] = drive.measured[0], drive.measured_acceleration[0], drive.torque[0]
    if not np.all(np.isfinite(track)):
        raise SimulationError(
            f"the simulation of {recording.name} with model {model.name} diverges; check its servo gains."
        )
    sampler = Sampler(recording, 1, dt)
    sampler.take(track, 0)
    run = sampler.rollout()
    return run.at(0)
