"""What a camera would see of a robot in the joint positions of a log: nothing but the robot, as the paper renders it."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.engines.bullet.client import World
from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.robot import RobotModel

ROBOT = 2  # class number, as in the environments


class RobotView:
    """A robot model before a camera; close it when done, or use it in a `with`.

    size: width and height of the pictures.
    Raises: ModelError or SimulationError where model or camera cannot be used.
    """

    def __init__(self, model: RobotModel, camera: Camera, size: tuple[int, int]) -> None:
        if camera.link is not None:
            raise SimulationError(
                f"camera {camera.name} sits on {camera.link}; only a camera that stands still is dreamed."
            )
        self.camera, self.size, self._client = camera, size, World()
        self._renderer = Renderer(self._client, "tiny", size)
        self._plant = BulletPlant(model, self._client)
        self._classes = dict.fromkeys(self._plant.ids, ROBOT)
        self._parts = list(dict.fromkeys(self._plant.links.values()))

    def __enter__(self) -> RobotView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the physics."""
        if self._client.isConnected():
            self._renderer.close()
            self._client.disconnect()

    def at(self, position: np.ndarray) -> Frame:
        """Picture, depth, classes and links of the robot at joint positions (n,)."""
        still = np.zeros_like(position)
        self._plant.reset(position, still, position)
        return self._renderer.capture(self.camera, self.size, classes=self._classes, parts=self._parts)
