"""The PyBullet plant: the same drive as the fits, with PyBullet's bodies, contacts and clock."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive
from embodiedreamer_gym.simulation.rollout import (
    Rollout,
    Sampler,
    check_names,
    command_rule,
    first_state,
    plant_commands,
)


class BulletPlant:
    """A robot model in PyBullet under torque control.

    PyBullet ignores URDF joint friction, knows no rotor inertia, damps joints explicitly, caches masses and gives
    1 kg to a link without an inertial; so its motors and dampings are switched off, such links are made weightless,
    and each step gets the torque that makes its bodies accelerate as the model's drive says (inverse dynamics of
    PyBullet's own masses). Payload, tilt and rotor inertia come in this way.
    """

    def __init__(self, model: RobotModel, client: BulletClient | None = None, dt: float = TIME_STEP) -> None:
        self.model, self.dt = model, dt
        self._own = client is None
        self.client = BulletClient(pybullet.DIRECT) if client is None else client
        self.client.setTimeStep(dt)
        self.client.setGravity(0.0, 0.0, -9.81)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        self.body = self.client.loadURDF(str(model.urdf), useFixedBase=True, flags=flags)
        infos = [self.client.getJointInfo(self.body, j) for j in range(self.client.getNumJoints(self.body))]
        names = {info[1].decode(): j for j, info in enumerate(infos)}
        self._ids = [names[name] for name in model.tree.joint_names]
        weightless = _weightless(model.urdf)
        for link in range(-1, len(infos)):
            change = partial(self.client.changeDynamics, self.body, link)
            change(maxJointVelocity=1e4)  # in one call with jointDamping, PyBullet drops the latter
            change(linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
            if link >= 0 and infos[link][12].decode() in weightless:
                change(mass=0.0, localInertiaDiagonal=(0.0, 0.0, 0.0))
        zero = [0.0] * len(self._ids)
        self.client.setJointMotorControlArray(self.body, self._ids, pybullet.VELOCITY_CONTROL, forces=zero)
        tree = model.tree
        self._lead = np.array([np.flatnonzero(tree.coordinate == j)[0] for j in range(model.n)])
        self.drive = Drive(model, dt=dt)

    def reset(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> None:
        """Put the joints (n,) where the sensors saw them; memories rest at the first command (n,)."""
        self.drive.start(measured[None], velocity[None], command[None])
        tree = self.model.tree
        q = tree.gain * self.drive.position[0][tree.coordinate] + tree.offset
        v = tree.gain * velocity[tree.coordinate]
        for joint, angle, speed in zip(self._ids, q, v, strict=True):
            self.client.resetJointState(self.body, joint, float(angle), float(speed))

    def step(self, command: np.ndarray) -> np.ndarray:
        """Advance by one step under the command (n,); return the acceleration (n,) that the drive asked for."""
        tree, drive = self.model.tree, self.drive
        states = self.client.getJointStates(self.body, self._ids)
        q, v = np.array([s[0] for s in states]), np.array([s[1] for s in states])
        lead = self._lead
        drive.position = ((q[lead] - tree.offset[lead]) / tree.gain[lead])[None]
        drive.velocity = (v[lead] / tree.gain[lead])[None]
        acceleration = drive.accelerate(np.asarray(command, float)[None])
        _, force = self.model.bodies.inverse_dynamics(
            drive.position, drive.velocity, acceleration, self.model.nominal_mechanics
        )
        self.client.setJointMotorControlArray(self.body, self._ids, pybullet.TORQUE_CONTROL, forces=force[0].tolist())
        self.client.stepSimulation()
        drive.time += self.dt
        return acceleration[0]

    @property
    def measured(self) -> np.ndarray:
        """What the encoders (n,) read at the last step's start, in the joints' units."""
        return self.drive.measured[0]

    def close(self) -> None:
        """Disconnect, if the plant opened the connection itself; twice does no harm."""
        if self._own and self.client.isConnected():
            self.client.disconnect()

    def __enter__(self) -> BulletPlant:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def replay(model: RobotModel, recording: Recording, dt: float = TIME_STEP, hold: str | None = None) -> Rollout:
    """Free-run a recording in PyBullet itself; arrays (T, n) as `simulate` returns them.

    Raises: SimulationError when the recording is not of this robot or the simulation diverges.
    """
    check_names(model, recording)
    commands = plant_commands(recording, hold or command_rule(model, recording), dt)
    track = np.empty((3, len(commands), 1, model.n))
    with BulletPlant(model, dt=dt) as plant:
        plant.reset(*first_state(recording), commands[0])
        for k, command in enumerate(commands):
            track[1, k, 0] = plant.step(command)
            track[0, k, 0], track[2, k, 0] = plant.measured, plant.drive.torque[0]
    if not np.all(np.isfinite(track)):
        raise SimulationError(
            f"the simulation of {recording.name} with model {model.name} diverges; check its servo gains."
        )
    sampler = Sampler(recording, 1, dt)
    sampler.take(track, 0)
    run = sampler.rollout()
    return Rollout(run.time, run.position[0], run.velocity[0], run.torque[0])


def _weightless(urdf: Path) -> set[str]:
    """Names of the links to which a URDF gives no mass."""
    links = ElementTree.parse(urdf).getroot().iter("link")
    return {str(link.get("name")) for link in links if link.find("inertial/mass") is None}
