"""Renders a robot alone at the joint positions of a log, as in the paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from embodiedreamer_gym.engines import EngineSettings, engine_factory, has_pybullet
from embodiedreamer_gym.engines.engine import CLASSES
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.robot import RobotModel

TABLE = CLASSES.index("table")


class RobotView:
    """A robot model in front of a camera; close it when done, or use it in a `with` statement.

    size: width and height of the pictures, pixels.
    engine: auto, bullet or mujoco.
    table: height of the table top, m, z in the world; needed for a camera on a link. The table is then an unbounded plane,
        and table and background are parts.
    Raises: ModelError or SimulationError where model or camera cannot be used.
    """

    def __init__(
        self, model: RobotModel, camera: Camera, size: tuple[int, int], engine: str = "auto", table: float | None = None
    ) -> None:
        if camera.link is not None and table is None:
            raise SimulationError(
                f"camera {camera.name} is mounted on {camera.link}; give the height of the table, or use a fixed camera."
            )
        if table is not None and not np.isfinite(table):
            raise SimulationError(f"the table's height must be a finite number of metres, not {table}.")
        factory = engine_factory(engine)
        renderer = "tiny" if engine != "mujoco" and has_pybullet() else "auto"
        self.camera, self.size, self.table = camera, size, table
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
        frame = self._engine.capture(self.camera, self.size)
        return frame if self.camera.link is None or self.table is None else self._on_table(frame, self.table)

    def _on_table(self, frame: Frame, height: float) -> Frame:
        """A frame of a moving camera whose background below a height is the table."""
        number = len(self._engine.part_names) + 1  # of the table, after the links
        projection = frame.projections[number - 1].astype(float)  # of the world's frame
        back = np.linalg.inv(projection[:, :3])[2]  # a pixel's height above the camera, per metre of depth
        u, v = np.meshgrid(np.arange(self.size[0]), np.arange(self.size[1]))
        slope = back[0] * u + back[1] * v + back[2]
        depth = np.divide(height + back @ projection[:, 3], slope, out=np.full(slope.shape, np.inf), where=slope != 0)
        around = frame.segmentation <= TABLE
        shown = around & (depth > self.camera.near) & (depth < self.camera.far)
        return replace(
            frame, segmentation=np.where(around, np.where(shown, TABLE, 0), frame.segmentation).astype(np.uint8),
            depth=np.where(shown, depth, frame.depth).astype(np.float32),
            parts=np.where(around, np.where(shown, number, number + 1), frame.parts).astype(np.uint8),
        )  # fmt: skip
