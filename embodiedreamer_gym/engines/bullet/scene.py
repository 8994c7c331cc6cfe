"""The world around the robot: a table with props, PyBullet's contacts, and a reset that forgets the past."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import Sets

FAR = 50.0  # m
SETTLED = 2.0  # s, in which arms come to rest
PADS = {"lateralFriction": 1.0, "spinningFriction": 0.002, "rollingFriction": 0.0001}
REST = {"spinningFriction": 0.001, "rollingFriction": 0.0001}  # without the latter, a pen creeps by 3 mm in 10 s
CLASSES = ("background", "table", "robot")


class Scene:
    """Bodies in one PyBullet world: the robot's arms, the table, the props of a task.

    props: name -> PyBullet's body; bases: (3,) m, where each arm's first joint is; fingers: for each arm the links
    (body, index) that close on things; classes: PyBullet's body -> number of its segmentation class; class_names: what
    the numbers mean; parts: body and link of all that is rigid and may move, the robot's links and the props.
    """

    def __init__(
        self, client: BulletClient, model: RobotModel, props: tuple[Prop, ...], dt: float, collisions: bool = True
    ) -> None:
        self.client, self.model = client, model
        client.setPhysicsEngineParameter(deterministicOverlappingPairs=1, numSolverIterations=30)
        self.plant = BulletPlant(model, client, dt)
        self.table = self._load(TABLE)
        self._put(self.table, TABLE, Pose(np.array(TABLE_CENTRE), np.array([0.0, 0.0, 0.0, 1.0])))
        self._things = {prop.name: prop for prop in props}
        self.props = {prop.name: self._load(prop) for prop in props}
        self.classes = {self.table: 1, **dict.fromkeys(self.plant.bodies, 2)}
        self.classes |= {body: 3 + i for i, body in enumerate(self.props.values())}
        self.class_names = (*CLASSES, *self.props)
        self.parts = [*dict.fromkeys(self.plant.links.values()), *((body, -1) for body in self.props.values())]
        self.tips = [self.plant.links[name] for name in model.arms]
        tree = model.tree
        self.bases = [tree.origin[np.flatnonzero(tree.arm[tree.coordinate] == arm)[0]] for arm in range(tree.arms)]
        self.fingers = [self._fingers(arm) for arm in range(len(model.arms))]
        for body, link in (finger for arm in self.fingers for finger in arm):
            client.changeDynamics(body, link, **PADS)
        if not collisions:
            for body in self.plant.bodies:
                for link in range(-1, client.getNumJoints(body)):
                    client.setCollisionFilterGroupMask(body, link, 0, 0)

    def _load(self, prop: Prop) -> int:
        """Load a prop; with `useMaximalCoordinates` it costs 10 us less, but no episode can be repeated bit for bit."""
        with tempfile.TemporaryDirectory() as folder:
            for name, text in prop.files().items():
                (Path(folder) / name).write_text(text, encoding="utf-8")
            path = Path(folder) / f"{prop.name}.urdf"
            body = self.client.loadURDF(str(path), useFixedBase=prop.fixed, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        damping = {"linearDamping": 0.0, "angularDamping": 0.04}
        self.client.changeDynamics(body, -1, lateralFriction=prop.friction, **damping, **REST)
        return body

    def _fingers(self, arm: int) -> list[tuple[int, int]]:
        """Links that the gripper of an arm moves: those of its normalised or sliding coordinate."""
        tree = self.model.tree
        moved = [b for b in range(tree.bodies) if tree.prismatic[b] and tree.arm[tree.coordinate[b]] == arm]
        body = self.tips[arm][0]
        joints = {
            self.client.getJointInfo(body, j)[1].decode(): j for j in range(self.client.getNumJoints(body))
        }  # fmt: skip
        return [(body, joints[tree.joint_names[b]]) for b in moved]

    def reset(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray, poses: Mapping[str, Pose],
              sets: Sets | None = None) -> None:  # fmt: skip
        """Put robot and props in place, whatever went before.

        PyBullet keeps contact points of the last step, from which the next one starts: moved far apart and looked at
        once, the bodies lose them, so that the same reset gives the same episode bit for bit.
        """
        self._clear()
        self.plant.reset(position, velocity, command, sets)
        self.client.performCollisionDetection()
        for name, body in self.props.items():
            self._put(body, self._things[name], poses[name])
            self.client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))

    def settle(self, command: np.ndarray) -> np.ndarray:
        """What the encoders (n,) read where the arms rest under a command (n,), nothing on the table.

        Raises: SimulationError where the robot model diverges.
        """
        self._clear()
        self.plant.reset(command, np.zeros_like(command), command, {})  # the model as it is, whatever was drawn
        for _ in range(round(SETTLED / self.plant.dt)):
            self.plant.step(command)
        found = self.plant.observe()[0]
        if not np.isfinite(found).all():
            raise SimulationError(f"the arms of model {self.model.name} diverge at rest; check its servo gains.")
        return found

    def _clear(self) -> None:
        """Move the props out of the arms' way."""
        for i, body in enumerate(self.props.values()):
            self.client.resetBasePositionAndOrientation(body, (FAR * (i + 1), FAR, FAR), (0, 0, 0, 1))

    def _put(self, body: int, prop: Prop, pose: Pose) -> None:
        """Place a prop; PyBullet wants the pose of its centre of mass."""
        place = pose.position + pose.rotation @ prop.centre
        self.client.resetBasePositionAndOrientation(body, place.tolist(), pose.quaternion.tolist())

    def pose(self, name: str) -> Pose:
        """Where a prop is."""
        position, quaternion = self.client.getBasePositionAndOrientation(self.props[name])
        centre = Pose(np.array(position), np.array(quaternion))
        return Pose(centre.position - centre.rotation @ self._things[name].centre, centre.quaternion)

    def tip(self, arm: int) -> Pose:
        """Where the end effector of an arm is."""
        return self.link_pose(self.model.arms[arm])

    def link_pose(self, link: str) -> Pose:
        """Where the frame of a robot's link is."""
        body, index = self.plant.links[link]
        if index < 0:
            position, quaternion = self.client.getBasePositionAndOrientation(body)
        else:
            position, quaternion = self.client.getLinkState(body, index, computeForwardKinematics=True)[4:6]
        return Pose(np.array(position), np.array(quaternion))

    def speed(self, name: str) -> float:
        """Speed of a prop's origin, m/s."""
        return float(np.linalg.norm(self.client.getBaseVelocity(self.props[name])[0]))

    def touching(self, name: str) -> set[tuple[int, int]]:
        """What a prop touches: pairs of PyBullet's body and link."""
        points = self.client.getContactPoints(bodyA=self.props[name])
        return {(p[2], p[4]) for p in points if p[8] < 1e-3}
