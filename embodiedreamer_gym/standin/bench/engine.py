"""The stand-in world as an engine of environments: a robot with hidden effects in MuJoCo and a path-traced camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.engine import EngineSettings
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.engines.mujoco.furniture import Furniture
from embodiedreamer_gym.engines.mujoco.world import MujocoWorld
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.simulation.drive import Sets
from embodiedreamer_gym.standin.bench.pictures import PathTraced
from embodiedreamer_gym.standin.bench.robot import Effects, build_robot
from embodiedreamer_gym.standin.film.write import CAMERA

Pictures = Callable[[Mapping[str, np.ndarray]], np.ndarray]
PICTURES = ("traced", "none")
LONGEST_STEP = 5e-4  # s, of the engine
REST = 1e-6  # rad: largest difference between the requested start and the rest position


@dataclass(frozen=True)
class StandInWorld:
    """The stand-in for a real bench, for use as `AlohaEnv(engine=StandInWorld(...))`."""

    effects: Effects | None = None
    """Hidden effects of the robot, see `standin.hidden`."""
    seed_of_robot: int | None = 0
    """Seed of the robot's errors of mass and gain; None for no errors."""
    appearance: str = "lab"
    """lab, or an integer as the seed of a random bench."""
    pictures: str | Pictures = "traced"
    """traced; none for black pictures; or a function of the poses (4, 4) of links and props by name, whose method `close`,
    if it has one, is called with the world's."""
    blender: str | None = None
    """Path of a Python interpreter that has bpy; None for the current one or EMBODIEDREAMER_BLENDER."""

    def __call__(self, settings: EngineSettings) -> StandInEngine:
        """Build the world.

        Raises: EffectError for invalid effects, SimulationError, VisionError, MissingExtraError.
        """
        return StandInEngine(settings, self)


class StandInEngine(MujocoWorld):
    """The robot with hidden effects, a table and a task's props in MuJoCo; the controller ramps between commands."""

    name = "stand-in"

    def __init__(self, settings: EngineSettings, world: StandInWorld) -> None:
        super().__init__(settings)
        if not callable(world.pictures) and world.pictures not in PICTURES:
            raise SimulationError(f"pictures {world.pictures!r} is not one of {', '.join(map(repr, PICTURES))}.")
        self._period = 1.0 / settings.control_hz
        self._steps = int(np.ceil(self._period / LONGEST_STEP - 1e-9))
        joints = self.finger_joints()
        furniture = Furniture(settings.props, [name for arm in joints for name in arm])
        robot = build_robot(world.effects, world.seed_of_robot, self._period / self._steps, furniture)
        self.engine = robot.engine
        self.take_over(self.engine.model, self.engine.data)
        self.fingers = [[self.state.link_of(name) for name in arm] for arm in joints]
        self._pictures = world.pictures if callable(world.pictures) else None
        self._traced = None
        if world.pictures == "traced":
            self._traced = PathTraced(
                self.model, settings.props, world.appearance, settings.picture_size, world.blender
            )
        self.renderer_name = "cycles" if self._traced else "none"
        self.light: Mapping[str, Any] = {}
        self._commands: list[np.ndarray] = []
        self._noise = np.random.default_rng(0)

    def reset(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray, poses: Mapping[str, Pose],
              sets: Sets | None = None, rng: np.random.Generator | None = None) -> None:  # fmt: skip
        """Bring the arms to rest under the command and place the props.

        Raises: SimulationError when the arms do not come to rest, or another start is requested.
        """
        if rng is not None:
            self._noise = rng.spawn(1)[0]  # spawning does not change later draws
        rest = self.settle(command)
        if velocity.any() or np.abs(position - rest).max() > REST or sets is not None:
            raise SimulationError(
                "the stand-in world always starts at rest at its first command; do not pass "
                "another position, velocity or parameter set."
            )
        self._commands = [command]
        for prop in self.settings.props:
            self.state.place(prop, poses[prop.name])
        self.engine.refresh()

    def settle(self, command: np.ndarray) -> np.ndarray:
        """Encoder readings (n,) of the arms at rest under a command (n,), with an empty table."""
        self.engine.begin(command)
        return self.engine.encoders()

    def advance(self, target: np.ndarray) -> None:
        """Ramp to joint targets (n,) within one control period.

        Raises: SimulationError when the engine diverges.
        """
        self._commands.append(target)
        commands = np.array(self._commands)
        times = np.arange(len(commands)) * self._period
        self.engine.advance(lambda t: np.stack([np.interp(t, times, one) for one in commands.T], axis=1), self._steps)

    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Present encoder readings (n,) and joint speeds (n,)."""
        return self.engine.encoders(), self.engine.speeds()

    def poses(self) -> dict[str, np.ndarray]:
        """Poses (4, 4) of links, table and props, by name."""
        frames = {}
        for name in self.state.names[1:]:  # 0 is the world
            pose = self.state.pose(name)
            frames[name] = np.eye(4)
            frames[name][:3, :3], frames[name][:3, 3] = self.state.rotation(name), pose.position
        return frames

    def rgb(self, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """The head camera's picture (H, W, 3), uint8.

        Raises: SimulationError for another camera, or a size other than that of the settings.
        """
        width, height = size
        if camera.name != CAMERA or (self._traced is not None and size != self.settings.picture_size):
            raise SimulationError(f"the stand-in world shows camera '{CAMERA}' at {self.settings.picture_size} only.")
        if self._traced is not None:
            return self._traced.take(self.poses(), self._noise)
        if self._pictures is None:
            return np.zeros((height, width, 3), np.uint8)
        picture = np.asarray(self._pictures(self.poses()))
        if picture.shape != (height, width, 3) or picture.dtype != np.uint8:
            raise SimulationError(
                f"pictures must return uint8 of shape {(height, width, 3)}, not {picture.dtype} of {picture.shape}."
            )
        return picture

    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """Not available: a real bench has no ground truth.

        Raises: SimulationError always.
        """
        raise SimulationError("the stand-in world gives pictures without depth and classes, as a real bench does.")

    def close(self) -> None:
        """Close the camera; safe to call twice."""
        close = getattr(self._traced or self._pictures, "close", None)
        if close is not None:
            close()
