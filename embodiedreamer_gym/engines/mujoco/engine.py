"""The MuJoCo engine: the drive of the robot model with MuJoCo's bodies and contacts."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from embodiedreamer_gym.engines.engine import EngineSettings, PlantEngine
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.engines.hulls import part_hulls
from embodiedreamer_gym.engines.mujoco.bodies import MujocoBodies
from embodiedreamer_gym.engines.mujoco.furniture import LINKS, THINGS, Furniture, parked
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.engines.mujoco.rendering import LIGHT, Renderer, check_renderer
from embodiedreamer_gym.engines.mujoco.world import MujocoWorld
from embodiedreamer_gym.engines.plant import Plant
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.simulation.drive import Sets


class MujocoEngine(MujocoWorld, PlantEngine):
    """Bodies in one MuJoCo world; pictures are drawn with OpenGL, which needs EGL or OSMesa."""

    name = "mujoco"

    def __init__(self, settings: EngineSettings) -> None:
        super().__init__(settings)
        self.renderer_name, self.light = check_renderer(settings.renderer), LIGHT
        joints = self.finger_joints()
        furniture = Furniture(
            settings.props, [name for arm in joints for name in arm], drawn=True, table=settings.table
        )
        self._bodies = MujocoBodies(self.model, self.dt, furniture)
        model, self._data = self._bodies.model, self._bodies.data
        self.take_over(model, self._data)
        self.plant = Plant(self.model, self._bodies, self.dt)
        self.fingers = [[self.state.link_of(name) for name in arm] for arm in joints]
        self._let_arms_touch(settings.collisions)

    def _let_arms_touch(self, collisions: bool) -> None:
        """Give the links of each arm their own contact bit: arms touch each other and objects, but not themselves."""
        model = self._bodies.model
        shapes = np.isin(model.geom_bodyid, [model.body(name).id for name in self.link_names]) & (
            model.geom_contype > 0
        )
        if not collisions:
            model.geom_contype[shapes], model.geom_conaffinity[shapes] = 0, 0
            return
        trees = model.body_treeid[model.geom_bodyid]
        bits = {tree: LINKS << arm for arm, tree in enumerate(np.unique(trees[shapes & (trees >= 0)]))}
        every = sum(bits.values())
        for shape in np.flatnonzero(shapes & (trees >= 0)):
            bit = bits[trees[shape]]
            model.geom_contype[shape], model.geom_conaffinity[shape] = bit, THINGS | (every & ~bit)
        model.geom_conaffinity[~shapes & (model.geom_contype > 0)] |= every

    @cached_property
    def renderer(self) -> Renderer:
        """The renderer, created for the first picture.

        Raises: SimulationError where there is neither EGL nor OSMesa.
        """
        classes = {"table": 1, **dict.fromkeys(self.link_names, 2)}
        classes |= {prop.name: 3 + i for i, prop in enumerate(self.settings.props)}
        return Renderer(self._bodies.model, self.settings.renderer, classes, self.part_names)

    def reset(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray, poses: Mapping[str, Pose],
              sets: Sets | None = None, rng: np.random.Generator | None = None) -> None:  # fmt: skip
        """Place robot and props, independently of the past."""
        mujoco.mj_resetData(self._bodies.model, self._data)
        self.plant.reset(position, velocity, command, sets)
        self._command = command
        for prop in self.settings.props:
            self.state.place(prop, poses[prop.name])
        mujoco.mj_forward(self._bodies.model, self._data)

    def advance(self, target: np.ndarray) -> None:
        """Simulate one control period; the controller ramps to the target or holds it, as set in the robot model.

        Raises: SimulationError when the engine diverges.
        """
        super().advance(target)
        mujoco.mj_kinematics(self._bodies.model, self._data)  # after a step, poses are those of its start
        if self._data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise SimulationError(f"the simulation of {self.model.name} diverges in MuJoCo; check its servo gains.")

    def clear(self) -> None:
        """Move the props out of the arms' way."""
        mujoco.mj_resetData(self._bodies.model, self._data)
        for i, prop in enumerate(self.settings.props):
            self.state.place(prop, Pose(np.array(parked(i)), np.array([0.0, 0.0, 0.0, 1.0])))

    def rgb(self, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """Colours (H, W, 3), uint8, of a picture of a size (width, height)."""
        return self.renderer.rgb(self._data, camera, size, self.mount(camera))

    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """A picture of a size (width, height) with its ground truth."""
        frame = self.renderer.capture(self._data, camera, size, self.mount(camera), self.hulls)
        return self.around(frame, camera, size)

    @cached_property
    def hulls(self) -> np.ndarray:
        """Hulls of the parts."""
        return part_hulls(self.model, self.settings.props, self.part_names)

    def close(self) -> None:
        """Close the renderer; safe to call twice."""
        if "renderer" in self.__dict__:
            self.renderer.close()
