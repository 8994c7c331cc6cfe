"""Draws pictures of a MuJoCo world with OpenGL, without a display, through EGL or OSMesa."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.frame import Frame, projections
from embodiedreamer_gym.engines.mujoco.furniture import DRAWN
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.errors import SimulationError, brief
from embodiedreamer_gym.geometry.camera import Camera, Pose

RENDERERS = ("auto", "egl", "osmesa")
LARGEST = (2048, 2048)  # pixels of the offscreen buffer
LIGHT_POSITION = (-3.0, 2.5, 5.0)  # m
BACKGROUND = (214, 216, 220)  # RGB of the background
LIGHT: Mapping[str, Any] = {
    "position": list(LIGHT_POSITION), "colour": [1.0, 1.0, 1.0], "ambient": 0.6, "diffuse": 0.4, "specular": 0.05,
    "shadow": False, "background": list(BACKGROUND),
}  # fmt: skip
GEOMS = 2000  # largest number of drawn geoms


def check_renderer(choice: str) -> str:
    """Return the name of a renderer of this engine; whether it works is checked with the first picture.

    Raises: SimulationError for an unknown name.
    """
    if not isinstance(choice, str) or choice not in RENDERERS:
        raise SimulationError(
            f"renderer {brief(choice)} is not one of {', '.join(map(repr, RENDERERS))} of engine 'mujoco'."
        )
    return choice


def open_context(choice: str, size: tuple[int, int]) -> tuple[Any, str]:
    """An OpenGL context, made current, and its kind: egl or osmesa.

    Raises: SimulationError where none can be created.
    """
    reasons = []
    for kind in ("egl", "osmesa") if choice == "auto" else (choice,):
        before = os.environ.get("PYOPENGL_PLATFORM")
        os.environ["PYOPENGL_PLATFORM"] = kind
        try:
            if kind == "egl":
                from mujoco.egl import GLContext
            else:
                from mujoco.osmesa import GLContext
            context = GLContext(*size)
            context.make_current()
            return context, kind
        except (ImportError, AttributeError, RuntimeError, OSError) as error:
            reasons.append(f"{kind}: {' '.join(str(error).split())[:80]}")
            if before is None:
                del os.environ["PYOPENGL_PLATFORM"]
            else:
                os.environ["PYOPENGL_PLATFORM"] = before
    raise SimulationError(
        f"engine 'mujoco' draws pictures by EGL or OSMesa, and neither can be loaded ({'; '.join(reasons)}); install one "
        "of them (Debian: libegl1 libgl1-mesa-dri, or libosmesa6), or use obs_type='state'."
    )


class Renderer:
    """Draws a MuJoCo model's bodies; close it when done.

    choice: auto, egl or osmesa.
    classes: body name -> class number; 0 for those left out.
    parts: names of the rigid bodies that `Frame.parts` numbers, from 1.
    Raises: SimulationError where there is no OpenGL.
    """

    def __init__(self, model: Any, choice: str, classes: Mapping[str, int], parts: Sequence[str]) -> None:
        self._gl, self.name = open_context(choice, LARGEST)
        self._model = model
        model.vis.global_.offwidth, model.vis.global_.offheight = LARGEST
        model.vis.quality.offsamples = 0  # each pixel shows a single geom, as in the segmentation
        model.vis.headlight.active = 0
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=GEOMS)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 0
        self._option.geomgroup[DRAWN] = 1
        names = [model.body(i).name for i in range(model.nbody)]
        self._class_of_geom = self._numbers([classes.get(name, 0) for name in names])
        self._part_of_geom = self._numbers([parts.index(name) + 1 if name in parts else 0 for name in names])
        self._part_bodies = [names.index(name) for name in parts]

    def _numbers(self, by_body: Sequence[int]) -> np.ndarray:
        """A number for each geom of the model, uint8, from that of its body; a final 0 for the background."""
        return np.append(np.array(by_body)[self._model.geom_bodyid], 0).astype(np.uint8)

    def rgb(self, data: Any, camera: Camera, size: tuple[int, int], mount: Pose | None = None) -> np.ndarray:
        """Colours (H, W, 3), uint8; size: width, height; mount: pose of the link that carries the camera."""
        self._prepare(data, camera, size, mount)
        rgb, depth = self._draw(size)
        rgb[depth >= 1.0] = BACKGROUND
        return rgb

    def capture(self, data: Any, camera: Camera, size: tuple[int, int], mount: Pose | None, hulls: np.ndarray) -> Frame:
        """A picture with its ground truth; arguments as for `rgb`; hulls: of the parts, see `Frame`."""
        self._prepare(data, camera, size, mount)
        rgb, depth = self._draw(size)
        rgb[depth >= 1.0] = BACKGROUND
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        ids = self._draw(size)[0].astype(np.int64) @ (1, 1 << 8, 1 << 16)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        drawn = np.full(self._scene.ngeom + 1, -1)  # number of a drawn geom, from 1 -> geom of the model
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                drawn[geom.segid + 1] = geom.objid
        geoms = drawn[np.minimum(ids, self._scene.ngeom)]
        position, axes = camera.pose(mount)
        poses = [(data.xpos[body], data.xmat[body].reshape(3, 3)) for body in self._part_bodies]
        return Frame(rgb, camera.depth(depth), self._class_of_geom[geoms], self._part_of_geom[geoms],
                     projections(camera.matrix(size), position, axes, poses), hulls)  # fmt: skip

    def close(self) -> None:
        """Free OpenGL's resources; safe to call twice."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._gl = None

    def _prepare(self, data: Any, camera: Camera, size: tuple[int, int], mount: Pose | None) -> None:
        """Update the scene from MuJoCo's data and set the camera."""
        if self._gl is None:
            raise SimulationError("the renderer is closed; make a new environment.")
        if size[0] > LARGEST[0] or size[1] > LARGEST[1]:
            raise SimulationError(
                f"engine 'mujoco' draws pictures of up to {LARGEST[0]} x {LARGEST[1]} pixels, not {size[0]} x {size[1]}."
            )
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, mujoco.MjvCamera(), everything, self._scene)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "HAZE"):
            self._scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        self._light()
        position, axes = camera.pose(mount)
        (fx, _, cx), (_, fy, cy), _ = camera.matrix(size)
        left, right = -(cx + 0.5) / fx, (size[0] - cx - 0.5) / fx
        top, bottom = (cy + 0.5) / fy, -(size[1] - cy - 0.5) / fy
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = position, axes[:, 2], -axes[:, 1]
            eye.orthographic = 0
            eye.frustum_near, eye.frustum_far = camera.near, camera.far
            eye.frustum_center, eye.frustum_width = camera.near * (left + right) / 2, camera.near * (right - left) / 2
            eye.frustum_top, eye.frustum_bottom = camera.near * top, camera.near * bottom

    def _light(self) -> None:
        """Set one light above the robot's left shoulder, as in the PyBullet engine."""
        self._scene.nlight = 1
        lamp = self._scene.lights[0]
        lamp.pos, lamp.dir = LIGHT_POSITION, -np.array(LIGHT_POSITION) / np.linalg.norm(LIGHT_POSITION)
        lamp.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        lamp.castshadow, lamp.headlight, lamp.cutoff, lamp.exponent = 0, 0, 180.0, 0.0
        lamp.attenuation = (1.0, 0.0, 0.0)
        lamp.ambient, lamp.diffuse = np.full(3, LIGHT["ambient"]), np.full(3, LIGHT["diffuse"])
        lamp.specular = np.full(3, LIGHT["specular"])

    def _draw(self, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Colours (H, W, 3), uint8, and depth buffer (H, W), 0 near .. 1 far; row 0 is at the top."""
        view = mujoco.MjrRect(0, 0, *size)
        rgb, depth = np.empty((size[1], size[0], 3), np.uint8), np.empty((size[1], size[0]), np.float32)
        mujoco.mjr_render(view, self._scene, self._context)
        mujoco.mjr_readPixels(rgb, depth, view, self._context)
        return np.ascontiguousarray(rgb[::-1]), depth[::-1]
