"""Renders a robot alone at the joint positions of a log, as in the paper."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.engines import EngineSettings, engine_factory, has_pybullet
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.robot import RobotModel


class RobotView:
    """A robot model in front of a camera; close it when done, or use it in a `with` statement.

    camera: fixed in the world.
    size: width and height of the pictures, pixels.
    engine: auto, bullet or mujoco.
    Raises: ModelError or SimulationError where model or camera cannot be used.
    """

    def __init__(self, model: RobotModel, camera: Camera, size: tuple[int, int], engine: str = "auto") -> None:
        if camera.link is not None:
            raise SimulationError(f"camera {camera.name} is mounted on {camera.link}; only a fixed camera can be used.")
        factory = engine_factory(engine)
        renderer = "tiny" if engine != "mujoco" and has_pybullet() else "auto"
        self.camera, self.size = camera, size
        self._engine = factory(EngineSettings(model, (), renderer=renderer, picture_size=size, table=False))

    def __enter__(self) -> RobotView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the engine."""
        self._engine.close()

    def at(self, position: np.ndarray) -> Frame:
        """Picture, depth, classes and links of the robot at joint positions (n,)."""
        self._engine.reset(position, np.zeros_like(position), position, {})
        return self._engine.capture(self.camera, self.size)
