"""The PyBullet plant: the same drive as the fits, with PyBullet's bodies, contacts and clock."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.engines.bullet.bodies import ArmBody, arm_bodies, bullet_mechanics, rotors
from embodiedreamer_gym.engines.bullet.client import World
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive, Sets
from embodiedreamer_gym.simulation.rollout import (
    Rollout,
    Sampler,
    check_names,
    command_rule,
    first_state,
    plant_commands,
)

LINKAGE = 60.0  # rad/s at which joints that move as one (the fingers of a gripper) are drawn together again


class BulletPlant:
    """A robot model in PyBullet under torque control.

    PyBullet ignores URDF joint friction, knows no rotor inertia, damps joints explicitly, caches masses and gives
    1 kg to a link without an inertial; so its motors and dampings are switched off, such links are made weightless,
    and each step gets the torque that makes its bodies accelerate as the model's drive says (inverse dynamics of
    PyBullet's own masses). Payload, tilt and rotor inertia come in this way. It ignores `mimic` too: joints that one
    coordinate moves get the same acceleration, and a spring and damper hold them together in contact.

    bodies: PyBullet's ids of the arms; links: link name -> (body, PyBullet's link index).
    """

    def __init__(self, model: RobotModel, client: BulletClient | None = None, dt: float = TIME_STEP) -> None:
        self.model, self.dt = model, dt
        self._own = client is None
        self.client = World() if client is None else client
        self._joint_states, self._drive_joints = self.client.getJointStates, self.client.setJointMotorControlArray
        self._advance = self.client.stepSimulation  # looked up once: the client builds them anew at each call
        self.client.setTimeStep(dt)
        self.client.setGravity(0.0, 0.0, -9.81)
        self.links: dict[str, tuple[int, int]] = {}
        found: dict[str, tuple[int, int]] = {}
        with tempfile.TemporaryDirectory() as folder:
            loaded = [self._load(part, Path(folder) / f"{model.urdf.stem}-{i}.urdf", found)
                      for i, part in enumerate(arm_bodies(model))]  # fmt: skip
        self.bodies = tuple(loaded)
        tree = model.tree
        order = [b for body in self.bodies for b, name in enumerate(tree.joint_names) if found[name][0] == body]
        ids = {body: [found[tree.joint_names[b]][1] for b in order if found[tree.joint_names[b]][0] == body]
               for body in self.bodies}  # fmt: skip
        ends = np.cumsum([0, *map(len, ids.values())]).tolist()
        self._calls = [(body, ids[body], slice(*ends[i : i + 2])) for i, body in enumerate(ids)]
        self._order = np.array(order)  # the tree's bodies as PyBullet has them, arm after arm
        self._switch_off()
        self._add_rotors()
        self._mechanics = bullet_mechanics(model)
        self._read_q, self._read_v, self._shift = self._linkage()
        self.drive = Drive(model, dt=dt)

    def _load(self, part: ArmBody, path: Path, found: dict[str, tuple[int, int]]) -> int:
        """Load one arm, switch PyBullet's dampings off, and note its joints and links."""
        path.write_text(part.urdf, encoding="utf-8")
        body = self.client.loadURDF(str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        infos = [self.client.getJointInfo(body, j) for j in range(self.client.getNumJoints(body))]
        self.links.setdefault(self.client.getBodyInfo(body)[0].decode(), (body, -1))
        for j, info in enumerate(infos):
            found[info[1].decode()] = (body, j)
            self.links.setdefault(info[12].decode(), (body, j))
        for link in range(-1, len(infos)):
            change = partial(self.client.changeDynamics, body, link)
            change(maxJointVelocity=1e4)  # in one call with jointDamping, PyBullet drops the latter
            change(linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
            if link >= 0 and infos[link][12].decode() in part.weightless:
                change(mass=0.0, localInertiaDiagonal=(0.0, 0.0, 0.0))
        return body

    def _switch_off(self) -> None:
        """Disable PyBullet's own motors, of joints that stay at zero too."""
        for body in self.bodies:
            kinds = [self.client.getJointInfo(body, j)[2] for j in range(self.client.getNumJoints(body))]
            moving = [j for j, kind in enumerate(kinds) if kind != pybullet.JOINT_FIXED]
            idle = [0.0] * len(moving)
            self.client.setJointMotorControlArray(body, moving, pybullet.VELOCITY_CONTROL, forces=idle)

    def _add_rotors(self) -> None:
        """Give each driven link its share of rotor inertia, as `bullet_mechanics` counts it."""
        tree, shares = self.model.tree, rotors(self.model)
        for body, ids, rows in self._calls:
            for joint, b in zip(ids, self._order[rows], strict=True):
                mass, _, inertia = self.client.getDynamicsInfo(body, joint)[:3]
                if tree.prismatic[b]:
                    mass += shares[b]
                else:
                    inertia = tuple(float(x + shares[b]) for x in inertia)
                self.client.changeDynamics(body, joint, mass=float(mass), localInertiaDiagonal=inertia)

    def _linkage(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices (n + k, k) and a shift (n + k,): driven joints, and the forces that hold linked joints together.

        From PyBullet's joints q: _read_q @ q - shift gives the n driven joints (a mean over those that move as one)
        and each body's spring force; _read_v @ v their speeds and each body's damper force.
        """
        tree, n, k = self.model.tree, self.model.n, self.model.tree.bodies
        count = np.bincount(tree.coordinate, minlength=n)[tree.coordinate]
        mean = np.zeros((n, k))
        mean[tree.coordinate, np.arange(k)] = 1.0 / (tree.gain * count)
        apart = np.eye(k) - tree.gain[:, None] * mean[tree.coordinate]
        weight = np.where(count > 1, self._mechanics.mass[0], 0.0)
        shift = np.concatenate([mean @ tree.offset, weight * LINKAGE**2 * (apart @ tree.offset)])
        spring, damper = weight[:, None] * LINKAGE**2 * apart, weight[:, None] * 2 * LINKAGE * apart
        columns = self._order
        return np.vstack([mean, spring])[:, columns], np.vstack([mean, damper])[:, columns], shift

    def reset(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray, sets: Sets | None = None) -> None:
        """Put the joints (n,) where the sensors saw them; memories rest at the first command (n,).

        sets: parameter group -> (1, joints or arms) that replace the model's own from now on.
        """
        if sets is not None:
            self.drive = Drive(self.model, sets, dt=self.dt)
        self.drive.start(measured[None], velocity[None], command[None])
        tree = self.model.tree
        q = tree.gain * self.drive.position[0][tree.coordinate] + tree.offset
        v = tree.gain * velocity[tree.coordinate]
        q, v = q[self._order].tolist(), v[self._order].tolist()
        for body, ids, rows in self._calls:
            self.client.resetJointStatesMultiDof(body, ids, [[x] for x in q[rows]], [[x] for x in v[rows]])

    def step(self, command: np.ndarray) -> np.ndarray:
        """Advance by one step under the command (n,); return the acceleration (n,) that the drive asked for."""
        drive = self.drive
        linkage = self._read()
        acceleration = drive.accelerate(command[None])
        _, force = self.model.bodies.inverse_dynamics(drive.position, drive.velocity, acceleration, self._mechanics)
        forces = (force[0] - linkage)[self._order].tolist()
        for body, ids, rows in self._calls:
            self._drive_joints(body, ids, pybullet.TORQUE_CONTROL, forces=forces[rows])
        self._advance()
        drive.time += self.dt
        return acceleration[0]

    def _read(self) -> np.ndarray:
        """Take PyBullet's joints over into the drive; the forces (k,) that are to hold linked joints together."""
        states = [s for body, ids, _ in self._calls for s in self._joint_states(body, ids)]
        q = self._read_q @ np.array([s[0] for s in states]) - self._shift
        v = self._read_v @ np.array([s[1] for s in states])
        n = self.model.n
        self.drive.position, self.drive.velocity = q[None, :n], v[None, :n]
        return q[n:] + v[n:]

    @property
    def measured(self) -> np.ndarray:
        """What the encoders (n,) read at the last step's start, in the joints' units."""
        return self.drive.measured[0]

    def observe(self) -> tuple[np.ndarray, np.ndarray]:
        """What the encoders (n,) read now, and the joints' speed (n,), without a step."""
        self._read()
        return self.drive.read()[0], self.drive.velocity[0].copy()

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
    return Rollout(run.time, run.position[0], run.velocity[0], run.torque[0])
