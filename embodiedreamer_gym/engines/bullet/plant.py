"""A robot model's bodies in PyBullet."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from embodiedreamer_gym.engines.bullet.bodies import ArmBody, arm_bodies, bullet_mechanics
from embodiedreamer_gym.engines.bullet.client import BulletClient, World, pybullet
from embodiedreamer_gym.engines.plant import Plant, rotor_shares
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP


class BulletBodies:
    """The arms of a robot model in a PyBullet world.

    PyBullet ignores URDF joint friction, has no rotor inertia, damps joints explicitly, caches masses and gives
    1 kg to a link without an inertial. So its motors and damping are switched off, and such links are made weightless.

    ids: PyBullet's ids of the arms; links: link name -> (body, PyBullet's link index).
    """

    def __init__(self, model: RobotModel, client: BulletClient, dt: float) -> None:
        self.model, self.client = model, client
        self._joint_states, self._drive_joints = client.getJointStates, client.setJointMotorControlArray
        self._advance = client.stepSimulation  # looked up once, as the client creates them at each access
        client.setTimeStep(dt)
        client.setGravity(0.0, 0.0, -9.81)
        self.links: dict[str, tuple[int, int]] = {}
        joints: dict[str, tuple[int, int]] = {}
        with tempfile.TemporaryDirectory() as folder:
            self.ids = tuple(self._load(part, Path(folder) / f"{model.urdf.stem}-{i}.urdf", joints)
                             for i, part in enumerate(arm_bodies(model)))  # fmt: skip
        tree = model.tree
        order = [b for body in self.ids for b, name in enumerate(tree.joint_names) if joints[name][0] == body]
        indices = {body: [joints[tree.joint_names[b]][1] for b in order if joints[tree.joint_names[b]][0] == body]
                   for body in self.ids}  # fmt: skip
        ends = np.cumsum([0, *map(len, indices.values())]).tolist()
        self._calls = [(body, indices[body], slice(*ends[i : i + 2])) for i, body in enumerate(indices)]
        self.order = np.array(order)
        self.force = np.zeros(tree.bodies)
        self.armature = np.zeros(tree.bodies)  # the links themselves carry the rotors' inertia
        self._switch_off()
        self._add_rotors()
        self.mechanics = bullet_mechanics(model)

    def _load(self, part: ArmBody, path: Path, joints: dict[str, tuple[int, int]]) -> int:
        """Load one arm, switch PyBullet's damping off, and record its joints and links."""
        path.write_text(part.urdf, encoding="utf-8")
        body = self.client.loadURDF(str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        infos = [self.client.getJointInfo(body, j) for j in range(self.client.getNumJoints(body))]
        self.links.setdefault(self.client.getBodyInfo(body)[0].decode(), (body, -1))
        for j, info in enumerate(infos):
            joints[info[1].decode()] = (body, j)
            self.links.setdefault(info[12].decode(), (body, j))
        for link in range(-1, len(infos)):
            change = partial(self.client.changeDynamics, body, link)
            change(maxJointVelocity=1e4)  # in one call with jointDamping, PyBullet drops the latter
            change(linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
            if link >= 0 and infos[link][12].decode() in part.weightless:
                change(mass=0.0, localInertiaDiagonal=(0.0, 0.0, 0.0))
        return body

    def _switch_off(self) -> None:
        """Disable PyBullet's own motors, also of joints that stay at zero."""
        for body in self.ids:
            kinds = [self.client.getJointInfo(body, j)[2] for j in range(self.client.getNumJoints(body))]
            moving = [j for j, kind in enumerate(kinds) if kind != pybullet.JOINT_FIXED]
            idle = [0.0] * len(moving)
            self.client.setJointMotorControlArray(body, moving, pybullet.VELOCITY_CONTROL, forces=idle)

    def _add_rotors(self) -> None:
        """Give each driven link its share of rotor inertia, as in `bullet_mechanics`."""
        tree, shares = self.model.tree, rotor_shares(self.model)
        for body, ids, rows in self._calls:
            for joint, b in zip(ids, self.order[rows], strict=True):
                mass, _, inertia = self.client.getDynamicsInfo(body, joint)[:3]
                if tree.prismatic[b]:
                    mass += shares[b]
                else:
                    inertia = tuple(float(x + shares[b]) for x in inertia)
                self.client.changeDynamics(body, joint, mass=float(mass), localInertiaDiagonal=inertia)

    def place(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set joint positions and velocities (k,)."""
        q, v = position.tolist(), velocity.tolist()
        for body, ids, rows in self._calls:
            self.client.resetJointStatesMultiDof(body, ids, [[x] for x in q[rows]], [[x] for x in v[rows]])

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities (k,)."""
        states = [s for body, ids, _ in self._calls for s in self._joint_states(body, ids)]
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def advance(self) -> None:
        """Take one physics step under the joint forces."""
        forces = self.force.tolist()
        for body, ids, rows in self._calls:
            self._drive_joints(body, ids, pybullet.TORQUE_CONTROL, forces=forces[rows])
        self._advance()


class BulletPlant(Plant):
    """A robot model in PyBullet; without a client, it opens its own world."""

    def __init__(self, model: RobotModel, client: BulletClient | None = None, dt: float = TIME_STEP) -> None:
        self._own = client is None
        self.client = World() if client is None else client
        bodies = BulletBodies(model, self.client, dt)
        self.ids, self.links = bodies.ids, bodies.links
        super().__init__(model, bodies, dt)

    def close(self) -> None:
        """Disconnect if the plant opened the connection itself; safe to call twice."""
        if self._own and self.client.isConnected():
            self.client.disconnect()

    def __enter__(self) -> BulletPlant:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
