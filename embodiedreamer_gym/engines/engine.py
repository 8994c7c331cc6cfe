"""The interface of a physics engine for the environments: a robot, a table and a task's props in one world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.frame import Frame, with_surroundings
from embodiedreamer_gym.engines.plant import Plant
from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import Sets

CLASSES = ("background", "table", "robot")
SETTLED = 2.0  # s, after which arms are at rest
STEPS_PER_SECOND = {
    50: 250,
    40: 240,
    30: 240,
    20: 240,
}  # control rate, Hz -> physics steps per second, a multiple of it
FINGER_FRICTION, TIP_SPIN, TIP_ROLL = 1.0, 0.002, 0.0001  # lateral; m, spinning and rolling


@dataclass(frozen=True)
class EngineSettings:
    """Settings of an engine, from the environment."""

    model: RobotModel
    """The robot."""
    props: tuple[Prop, ...]
    """The task's props."""
    control_hz: int = 30
    """Actions per second: 50, 40, 30 or 20."""
    collisions: bool = True
    """False lets the arms pass through everything."""
    renderer: str = "auto"
    """Renderer of the pictures; the choices depend on the engine."""
    picture_size: tuple[int, int] = (128, 96)
    """Width and height of the largest pictures that are drawn often, pixels."""
    table: bool = True
    """Whether there is a table."""


class Engine(ABC):
    """One world: the robot's arms, a table, and the props of a task.

    name: of the engine.
    light: constants of the renderer's light, JSON-compatible.
    class_names: names of the class numbers of a segmentation.
    part_names: names of the rigid parts, links then props, in the order of `Frame.projections`.
    bases: for each arm, the position (3,), m, of its first joint.
    fingers: for each arm, the names of the links that grip objects.
    """

    name: str
    renderer_name: str
    light: Mapping[str, Any]
    part_names: tuple[str, ...]

    def __init__(self, settings: EngineSettings) -> None:
        self.settings, self.model = settings, settings.model
        self.class_names = (*CLASSES, *(prop.name for prop in settings.props))
        tree = self.model.tree
        self.bases = [tree.origin[np.flatnonzero(tree.arm[tree.coordinate] == arm)[0]] for arm in range(tree.arms)]
        self.fingers: list[list[str]] = []

    def finger_joints(self) -> list[list[str]]:
        """For each arm, the joints of its gripper, which are the prismatic ones."""
        tree = self.model.tree
        sliding = [b for b in range(tree.bodies) if tree.prismatic[b]]
        return [[tree.joint_names[b] for b in sliding if tree.arm[tree.coordinate[b]] == arm]
                for arm in range(len(self.model.arms))]  # fmt: skip

    @abstractmethod
    def reset(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray, poses: Mapping[str, Pose],
              sets: Sets | None = None, rng: np.random.Generator | None = None) -> None:  # fmt: skip
        """Place robot and props; the same call gives the same episode, independently of the past.

        position, velocity, command: (n,) as the encoders read them; the command is the one before the first action.
        poses: of the props, by name.
        sets: parameters that replace the model's own, see `Drive`.
        rng: source of sensor noise, for engines that have some.
        """

    @abstractmethod
    def advance(self, target: np.ndarray) -> None:
        """Simulate one control period in which the controller moves to a target (n,)."""

    @abstractmethod
    def settle(self, command: np.ndarray) -> np.ndarray:
        """Encoder readings (n,) of the arms at rest under a command (n,), with an empty table.

        Raises: SimulationError where the arms do not come to rest.
        """

    @abstractmethod
    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Present encoder readings (n,) and joint speeds (n,)."""

    @abstractmethod
    def pose(self, prop: str) -> Pose:
        """Pose of a prop."""

    @abstractmethod
    def link_pose(self, link: str) -> Pose:
        """Pose of the frame of a robot's link."""

    @abstractmethod
    def links(self) -> Sequence[str]:
        """Names of the robot's links."""

    @abstractmethod
    def speed(self, prop: str) -> float:
        """Speed of a prop's centre of mass, m/s."""

    @abstractmethod
    def touching(self, prop: str) -> set[str]:
        """Names of the links, of the props and of "table" that a prop touches."""

    @abstractmethod
    def rgb(self, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """Colours (H, W, 3), uint8, of a picture of a size (width, height)."""

    @abstractmethod
    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """A picture of a size (width, height) with its ground truth."""

    @abstractmethod
    def close(self) -> None:
        """Close the world; safe to call twice."""

    def tip(self, arm: int) -> Pose:
        """Pose of an arm's end effector."""
        return self.link_pose(self.model.arms[arm])

    def around(self, frame: Frame, camera: Camera, size: tuple[int, int]) -> Frame:
        """The frame; if the camera moves, with table and background as parts too."""
        if camera.link is None:
            return frame
        links = len(self.part_names) - len(self.settings.props)
        return with_surroundings(frame, links, camera.matrix(size), *camera.pose(self.mount(camera)))

    def mount(self, camera: Camera) -> tuple[np.ndarray, np.ndarray] | None:
        """Position and quaternion of the link that carries a camera; None for a camera fixed in the world."""
        if camera.link is None:
            return None
        pose = self.link_pose(camera.link)
        return pose.position, pose.quaternion


EngineFactory = Callable[[EngineSettings], Engine]


class PlantEngine(Engine):
    """An engine that moves the robot with the drive of its model, so that the calibrated dynamics are simulated."""

    plant: Plant

    def __init__(self, settings: EngineSettings) -> None:
        super().__init__(settings)
        per_second = STEPS_PER_SECOND[settings.control_hz]
        self.dt, steps = 1.0 / per_second, per_second // settings.control_hz
        if self.model.command_hold == "hold":  # the first step is half old, half new
            self._shares = np.ones((steps, 1))
            self._shares[0] = 0.5
        else:
            self._shares = (np.arange(steps) / steps)[:, None]
        self._command = np.zeros(self.model.n)

    def advance(self, target: np.ndarray) -> None:
        """Simulate one control period; the controller ramps to the target or holds it, as set in the robot model."""
        step = self.plant.step
        for command in self._command + self._shares * (target - self._command):
            step(command)
        self._command = target

    def settle(self, command: np.ndarray) -> np.ndarray:
        """Encoder readings (n,) of the arms at rest under a command (n,), with an empty table.

        Raises: SimulationError where the robot model diverges.
        """
        self.clear()
        self.plant.reset(command, np.zeros_like(command), command, {})  # the model's own parameters, not drawn ones
        for _ in range(round(SETTLED / self.plant.dt)):
            self.plant.step(command)
        position = self.plant.observe()[0]
        if not np.isfinite(position).all():
            raise SimulationError(f"the arms of model {self.model.name} diverge at rest; check its servo gains.")
        return position

    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Present encoder readings (n,) and joint speeds (n,)."""
        return self.plant.observe()

    @abstractmethod
    def clear(self) -> None:
        """Move the props out of the arms' way."""
