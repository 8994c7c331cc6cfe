"""Draws pictures of a PyBullet world with TinyRenderer or OpenGL."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.engines.bullet import egl
from embodiedreamer_gym.engines.bullet.client import BulletClient, pybullet
from embodiedreamer_gym.engines.frame import Frame, projections
from embodiedreamer_gym.errors import SimulationError, brief
from embodiedreamer_gym.geometry.camera import Camera, Pose, rotation_matrix, whole_size

Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]
Part = tuple[int, int]  # PyBullet's body and link
LINK = 24  # bit from which on PyBullet's segmentation has the link + 1
BODY = (1 << LINK) - 1

CHOICES = ("auto", "tiny", "egl")
SMALL = 128 * 128  # pixels up to which TinyRenderer is as fast as OpenGL on a CPU
TINY_SHIFT = 0.5  # pixels by which TinyRenderer shifts pictures to the right and up, as it samples pixels' corners
LIGHT_POSITION = (-3.0, 2.5, 5.0)  # m: above the robot's left shoulder; the head camera sees no glare on the table
BACKGROUND = (214, 216, 220)  # RGB of the background; the renderers' own colours are white and lilac
LIGHTS: dict[str, dict[str, Any]] = {  # those of OpenGL are fixed in its shader
    "tiny": {"position": LIGHT_POSITION, "colour": (1.0, 1.0, 1.0), "ambient": 0.6, "diffuse": 0.4,
             "specular": 0.05, "shadow": False, "background": BACKGROUND},
    "egl": {"position": LIGHT_POSITION, "colour": (1.0, 1.0, 1.0), "ambient": 0.75, "diffuse": 0.25,
            "specular": 0.5, "shadow": False, "background": BACKGROUND},
}  # fmt: skip
IDENTITY = tuple(np.eye(4).ravel())
PAPER = np.array([*BACKGROUND, 255], np.uint8).view(np.uint32)[0]
NO_HULLS = np.zeros((0, 0, 3), np.float32)
ONE_TEXEL = (*([0.0] * 12), 0.5, 0.5, 1.0, 0.0)  # a projection that maps the whole world to one point of a texture


class Renderer:
    """Draws a PyBullet world with TinyRenderer on the CPU, or with OpenGL (EGL), which needs a driver but no display.

    Their lights differ; `name` and `light` describe the one that is used, e.g. for data sets. Bodies have colours, but
    no textures or shadows. Create the renderer before bodies are loaded. If several worlds of one process use OpenGL,
    call `activate` before bodies are loaded or removed later, and `close` before disconnecting.

    choice: tiny, egl, or auto: egl for pictures above 128 x 128 if it can be loaded; size: width, height.
    Raises: SimulationError for another choice, or egl where it cannot be loaded or bodies exist already.
    """

    def __init__(self, client: BulletClient, choice: str = "auto", size: tuple[int, int] = (128, 96)) -> None:
        if not isinstance(choice, str) or choice not in CHOICES:
            raise SimulationError(f"renderer {brief(choice)} is not one of {', '.join(map(repr, CHOICES))}.")
        width, height = whole_size(size)
        wanted = choice == "egl"
        if choice == "auto" and width * height > SMALL and egl.fits((width, height)):
            wanted = egl.is_available()
        self._client = client
        self._context = egl.EglContext(client) if wanted else None
        self.name = "egl" if wanted else "tiny"
        light = LIGHTS[self.name]
        self._fixed = {
            "renderer": pybullet.ER_BULLET_HARDWARE_OPENGL if wanted else pybullet.ER_TINY_RENDERER, "shadow": 0,
            "lightDirection": light["position"], "lightColor": light["colour"], "lightAmbientCoeff": light["ambient"],
            "lightDiffuseCoeff": light["diffuse"], "lightSpecularCoeff": light["specular"],
        }  # fmt: skip
        self._flags, self._shift = 0, TINY_SHIFT
        if wanted:  # the plugin's only mode without a shadow map, which takes longer than the picture
            self._flags, self._shift = pybullet.ER_USE_PROJECTIVE_TEXTURE, 0.0
            self._fixed |= {"projectiveTextureView": IDENTITY, "projectiveTextureProj": ONE_TEXEL}

    def __repr__(self) -> str:
        return f"Renderer({self.name!r})"

    def __del__(self) -> None:
        """Close the renderer, so that disconnecting this world's client does not affect the OpenGL of other worlds."""
        if getattr(self, "_context", None) is not None and not sys.is_finalizing():
            with contextlib.suppress(SimulationError):  # garbage collection in another thread
                self.close()

    @property
    def light(self) -> dict[str, Any]:
        """Constants of the light, JSON-compatible: position, m; shares of ambient, diffuse and specular light."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in LIGHTS[self.name].items()}

    def activate(self) -> None:
        """Prepare for bodies to be loaded or removed."""
        if self._context is not None:
            self._context.make_current()

    def close(self) -> None:
        """Release OpenGL; safe to call twice."""
        if self._context is not None:
            self._context.close()

    def rgb(self, camera: Camera, size: tuple[int, int], pose_of_link: Pose | None = None) -> np.ndarray:
        """Colours (H, W, 3), uint8, of a picture of a size (width, height); pose_of_link: of the camera's link.

        Raises: SimulationError when the camera's link has no pose, or the picture is too large.
        """
        return self._draw(camera, size, pose_of_link, pybullet.ER_NO_SEGMENTATION_MASK)[0]

    def capture(self, camera: Camera, size: tuple[int, int], pose_of_link: Pose | None = None,
                classes: Mapping[int, int] | None = None, parts: Sequence[Part] = (),
                hulls: np.ndarray = NO_HULLS) -> Frame:  # fmt: skip
        """Colours, depth and classes of a picture of a size (width, height).

        pose_of_link: position (3,), m, and quaternion (4,) xyzw of the frame of the camera's link; classes: PyBullet's
        body -> class number, 0 for bodies left out; parts: PyBullet's body and link (-1: the base) of the parts to
        number; hulls: of these parts, see `Frame`.
        Raises: SimulationError when the camera's link has no pose, the picture is too large or a class is not 0 .. 255.
        """
        numbers = _lookup(classes or {})
        flags = pybullet.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX if parts else 0
        rgb, buffer, drawn = self._draw(camera, size, pose_of_link, flags)
        bodies = np.where(drawn < 0, -1, drawn & BODY) if parts else drawn
        found = np.zeros(drawn.shape, np.uint8)
        for number, (body, link) in enumerate(parts, 1):
            found[drawn == body + (link + 1 << LINK)] = number
        return Frame(rgb, camera.depth(buffer), numbers[np.clip(bodies, -1, len(numbers) - 2) + 1], found,
                     self._projections(camera, size, pose_of_link, parts), hulls)  # fmt: skip

    def _projections(self, camera: Camera, size: tuple[int, int], pose_of_link: Pose | None,
                     parts: Sequence[Part]) -> np.ndarray:  # fmt: skip
        """Projections (L, 3, 4) of rigid parts."""
        here, axes = camera.pose(pose_of_link)
        poses = []
        for body, link in parts:
            if link < 0:
                position, quaternion = self._client.getBasePositionAndOrientation(body)
            else:
                position, quaternion = self._client.getLinkState(body, link, computeForwardKinematics=True)[4:6]
            poses.append((np.array(position), rotation_matrix(quaternion)))
        return projections(camera.matrix(size), here, axes, poses)

    def _draw(self, camera: Camera, size: tuple[int, int], pose_of_link: Pose | None, flags: int) -> Drawn:
        """Colours (H, W, 3), depth buffer (H, W) and PyBullet's bodies (H, W; -1: none) of a picture."""
        view, projection = camera.view(pose_of_link), camera.projection(size, self._shift)
        if self._context is not None:
            if not egl.fits(size):
                raise SimulationError(
                    f"renderer 'egl' draws pictures of up to {egl.LARGEST[0]} x {egl.LARGEST[1]} pixels, not "
                    f"{size[0]} x {size[1]}; use 'tiny'."
                )
            self._context.make_current()
        _, _, rgba, buffer, bodies = self._client.getCameraImage(
            *size, view, projection, flags=self._flags | flags, **self._fixed
        )
        rgba, buffer = _array(rgba, size, np.uint8), _array(buffer, size, np.float32)
        rgba.view(np.uint32)[buffer >= 1.0] = PAPER
        if flags != pybullet.ER_NO_SEGMENTATION_MASK:
            bodies = _array(bodies, size, np.int32)
        return cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), buffer, bodies


def _array(image: np.ndarray | tuple, size: tuple[int, int], kind: type[np.generic]) -> np.ndarray:
    """One image of `getCameraImage` as an array; PyBullet built without numpy returns flat tuples."""
    if isinstance(image, np.ndarray):
        return image
    if kind is np.uint8:  # a bytearray takes a fifth of the time of np.fromiter
        return np.frombuffer(bytearray(image), np.uint8).reshape(size[1], size[0], 4)
    return np.fromiter(image, kind, len(image)).reshape(size[1], size[0])


def _lookup(classes: Mapping[int, int]) -> np.ndarray:
    """Class number (bodies + 2,), uint8, by PyBullet's body + 1; 0 for bodies without a class."""
    table = np.zeros(max(classes, default=-1) + 3, np.uint8)  # one more, for bodies beyond the last one in classes
    for body, number in classes.items():
        if not 0 <= number <= 255:
            raise SimulationError(f"class {number} of body {body} is not one of 0 .. 255.")
        table[body + 1] = number
    return table
