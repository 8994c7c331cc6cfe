"""The path-traced camera of the bench, which takes pictures on request."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.film.appearance_library import find_appearance
from embodiedreamer_gym.standin.film.blender import Studio, find_blender
from embodiedreamer_gym.standin.film.camera_noise import NoisyCamera, add_sensor_noise, auto_exposure
from embodiedreamer_gym.standin.film.episode import AWAY
from embodiedreamer_gym.standin.film.geometry import scene_parts
from embodiedreamer_gym.standin.film.scene import Animation, make_scene
from embodiedreamer_gym.standin.film.settings import check_size
from embodiedreamer_gym.standin.film.write import CAMERA

SAMPLES = 4  # light paths per pixel, as in the films


class PathTraced:
    """Pictures (H, W, 3), uint8, of a robot and props at given poses, in an appearance, as in the films.

    Blender starts with the first picture. The exposure is set from that state without the props. appearance: lab or an
    integer; size: width, height; blender: path of a Python interpreter that has bpy, see `find_blender`.
    Raises: VisionError for another appearance or size; MissingExtraError without bpy.
    """

    def __init__(self, robot: RobotModel, props: Sequence[Prop], appearance: str, size: tuple[int, int],
                 blender: str | None = None) -> None:  # fmt: skip
        if appearance == "many":
            raise VisionError("a bench has one appearance; give lab, or a whole number that selects a random one.")
        check_size(size)
        self._appearance = find_appearance(appearance, 0)
        self._blender = find_blender(blender)
        self._optics = NoisyCamera(CAMERAS[CAMERA], size, self._appearance.camera_noise)
        self._parts = scene_parts(robot.urdf, props)
        self._props = {prop.name for prop in props}
        self.bodies = tuple(dict.fromkeys(part.body for part in self._parts))
        self._studio: Studio | None = None
        self._exposure = 0.0

    def take(self, poses: Mapping[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
        """A picture of `bodies` at poses (4, 4); rng: of the sensor's noise.

        Raises: SimulationError when Blender fails.
        """
        here = np.array([poses[name] for name in self.bodies])
        if self._studio is None:
            empty = here.copy()
            empty[[name in self._props for name in self.bodies], 2, 3] -= AWAY
            take = Animation(self._parts, self.bodies, empty[None])
            self._studio = Studio(make_scene(take, self._appearance, self._optics.wide, SAMPLES), self._blender)
            self._exposure = auto_exposure(self._optics.distort(self._studio.read()), self._optics.noise)
        return add_sensor_noise(self._optics.develop(self._studio.shoot(here), self._exposure), rng)

    def close(self) -> None:
        """Close Blender; the next picture would start it again."""
        if self._studio is not None:
            self._studio.close()
            self._studio = None
