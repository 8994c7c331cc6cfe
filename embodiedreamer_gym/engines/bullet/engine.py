"""The PyBullet engine: a table with props, PyBullet's contacts, and a reset that is independent of the past."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from embodiedreamer_gym.engines.bullet.client import World, pybullet
from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.engines.engine import (
    FINGER_FRICTION,
    TIP_ROLL,
    TIP_SPIN,
    EngineSettings,
    PlantEngine,
)
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.engines.hulls import part_hulls
from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.simulation.drive import Sets

FAR = 50.0  # m
GROUND = 5.0  # m, half the edge of the ground
PADS = {"lateralFriction": FINGER_FRICTION, "spinningFriction": TIP_SPIN, "rollingFriction": TIP_ROLL}
REST = {"spinningFriction": 0.001, "rollingFriction": 0.0001}  # without the latter, a pen creeps by 3 mm in 10 s
TOUCH = 1e-3  # m: bodies at a smaller distance touch


class BulletEngine(PlantEngine):
    """Bodies in one PyBullet world.

    client: PyBullet's; plant: the robot; table: PyBullet's body; bodies: prop -> PyBullet's body.
    """

    name = "bullet"

    def __init__(self, settings: EngineSettings) -> None:
        super().__init__(settings)
        self.client = client = World()
        self.renderer = Renderer(client, settings.renderer, settings.picture_size)  # before the first body is loaded
        self.renderer_name, self.light = self.renderer.name, self.renderer.light
        client.setPhysicsEngineParameter(deterministicOverlappingPairs=1, numSolverIterations=30)
        self.plant: BulletPlant = BulletPlant(self.model, client, self.dt)  # pyright: ignore[reportIncompatibleVariableOverride]
        self.table = -1
        if settings.table:
            self.table = self._load(TABLE)
            self._put(self.table, TABLE, Pose(np.array(TABLE_CENTRE), np.array([0.0, 0.0, 0.0, 1.0])))
        self._props = {prop.name: prop for prop in settings.props}
        self.bodies = {prop.name: self._load(prop) for prop in settings.props}
        self._classes = {self.table: 1, **dict.fromkeys(self.plant.ids, 2)}
        self._classes |= {body: 3 + i for i, body in enumerate(self.bodies.values())}
        links = {place: name for name, place in reversed(self.plant.links.items())}
        self._parts = [*dict.fromkeys(self.plant.links.values()), *((body, -1) for body in self.bodies.values())]
        self._names = links | {(body, -1): name for name, body in self.bodies.items()} | {(self.table, -1): TABLE.name}
        self.part_names = tuple(self._names[part] for part in self._parts)
        self.fingers = [[self._link_of(joint) for joint in joints] for joints in self.finger_joints()]
        for finger in (finger for arm in self.fingers for finger in arm):
            client.changeDynamics(*self.plant.links[finger], **PADS)
        if not settings.collisions:
            for body in self.plant.ids:
                for link in range(-1, client.getNumJoints(body)):
                    client.setCollisionFilterGroupMask(body, link, 0, 0)
        self._lay_ground()

    def _load(self, prop: Prop) -> int:
        """Load a prop; `useMaximalCoordinates` would save 10 us, but episodes would not be exactly repeatable."""
        with tempfile.TemporaryDirectory() as folder:
            for name, text in prop.files().items():
                (Path(folder) / name).write_text(text, encoding="utf-8")
            path = Path(folder) / f"{prop.name}.urdf"
            body = self.client.loadURDF(str(path), useFixedBase=prop.fixed, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        damping = {"linearDamping": 0.0, "angularDamping": 0.04}
        self.client.changeDynamics(body, -1, lateralFriction=prop.friction, **damping, **REST)
        return body

    def _link_of(self, joint: str) -> str:
        """Name of the link that a joint moves."""
        for body in self.plant.ids:
            for index in range(self.client.getNumJoints(body)):
                info = self.client.getJointInfo(body, index)
                if info[1].decode() == joint:
                    return info[12].decode()
        raise KeyError(joint)

    def _lay_ground(self) -> None:
        """Add an invisible ground below the table, so that props pushed off the table do not fall for ever."""
        client = self.client
        box = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(GROUND, GROUND, 0.1))
        # Without a visual shape PyBullet would draw the collision shape; this one is a speck inside it.
        speck = client.createVisualShape(pybullet.GEOM_SPHERE, radius=1e-3)
        client.createMultiBody(0.0, box, speck, basePosition=(0.0, 0.0, -0.1))

    def reset(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray, poses: Mapping[str, Pose],
              sets: Sets | None = None, rng: np.random.Generator | None = None) -> None:  # fmt: skip
        """Place robot and props, independently of the past.

        PyBullet keeps the contact points of the last step for the next one. To remove them, the props are first moved
        far apart and collisions are detected once, so that the same reset gives exactly the same episode.
        """
        self.clear()
        self.plant.reset(position, velocity, command, sets)
        self._command = command
        self.client.performCollisionDetection()
        for name, body in self.bodies.items():
            self._put(body, self._props[name], poses[name])
            self.client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))

    def clear(self) -> None:
        """Move the props out of the arms' way."""
        for i, body in enumerate(self.bodies.values()):
            self.client.resetBasePositionAndOrientation(body, (FAR * (i + 1), FAR, FAR), (0, 0, 0, 1))

    def _put(self, body: int, prop: Prop, pose: Pose) -> None:
        """Place a prop; PyBullet takes the pose of its centre of mass."""
        place = pose.position + pose.rotation @ prop.centre
        self.client.resetBasePositionAndOrientation(body, place.tolist(), pose.quaternion.tolist())

    def pose(self, prop: str) -> Pose:
        """Pose of a prop."""
        position, quaternion = self.client.getBasePositionAndOrientation(self.bodies[prop])
        centre = Pose(np.array(position), np.array(quaternion))
        return Pose(centre.position - centre.rotation @ self._props[prop].centre, centre.quaternion)

    def links(self) -> Sequence[str]:
        """Names of the robot's links."""
        return tuple(self.plant.links)

    def link_pose(self, link: str) -> Pose:
        """Pose of the frame of a robot's link."""
        body, index = self.plant.links[link]
        if index < 0:
            position, quaternion = self.client.getBasePositionAndOrientation(body)
        else:
            position, quaternion = self.client.getLinkState(body, index, computeForwardKinematics=True)[4:6]
        return Pose(np.array(position), np.array(quaternion))

    def speed(self, prop: str) -> float:
        """Speed of a prop's centre of mass, m/s."""
        return float(np.linalg.norm(self.client.getBaseVelocity(self.bodies[prop])[0]))

    def touching(self, prop: str) -> set[str]:
        """Names of the links, of the props and of "table" that a prop touches."""
        points = self.client.getContactPoints(bodyA=self.bodies[prop])
        return {self._names.get((p[2], p[4]), "") for p in points if p[8] < TOUCH} - {""}

    def rgb(self, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """Colours (H, W, 3), uint8, of a picture of a size (width, height)."""
        return self.renderer.rgb(camera, size, self.mount(camera))

    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """A picture of a size (width, height) with its ground truth."""
        frame = self.renderer.capture(camera, size, self.mount(camera), self._classes, self._parts, self.hulls)
        return self.around(frame, camera, size)

    @cached_property
    def hulls(self) -> np.ndarray:
        """Hulls of the parts; in PyBullet, a prop's frame is at its centre of mass."""
        centres = {name: prop.centre for name, prop in self._props.items()}
        return part_hulls(self.model, self.settings.props, self.part_names, centres)

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self.client.isConnected():
            self.renderer.close()
            self.client.disconnect()
