"""A pinhole camera: its pose and intrinsics, and both as OpenGL matrices."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.errors import EmbodieDreamerError, ModelError, SimulationError

Pose = tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]  # position (3,) m, quaternion (4,) xyzw


LARGEST = 1e6  # m or pixels, of any number of a camera


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, on a link of the robot or fixed in the world.

    position: (3,) m and rotation: quaternion (4,) xyzw of the camera's frame (x right, y down, z forward, as in
    OpenCV) in the frame of `link`, or in the world's when link is None.
    size: width and height of the pictures to which fx, fy, cx, cy refer (pixels; the centre of the first pixel is 0, 0,
    as in OpenCV); a picture of another size shows the same view. near, far: m, visible range.
    Raises: ModelError for invalid values.
    """

    name: str
    position: tuple[float, ...]
    rotation: tuple[float, ...]
    size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    link: str | None = None
    near: float = 0.05
    far: float = 5.0

    def __post_init__(self) -> None:
        position, rotation = self._vector("position", 3), self._vector("rotation", 4)
        length = math.hypot(*rotation)
        if abs(length - 1.0) > 0.01:
            self._fail(f"rotation must be a quaternion x, y, z, w of length 1, but its length is {length:.3g}")
        for field in ("fx", "fy", "cx", "cy", "near", "far"):
            number = float(getattr(self, field))
            if not abs(number) <= LARGEST:
                self._fail(f"{field} is {number}, not a finite number of at most {LARGEST:g}")
            if field not in ("cx", "cy") and number <= 0.0:
                self._fail(f"{field} is {number}, not above 0")
            object.__setattr__(self, field, number)
        if not self.near < self.far:
            self._fail(f"near ({self.near} m) is not below far ({self.far} m)")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", tuple(x / length for x in rotation))
        object.__setattr__(self, "size", whole_size(self.size))

    def _vector(self, field: str, count: int) -> tuple[float, ...]:
        numbers = tuple(float(x) for x in getattr(self, field))
        if len(numbers) != count or not all(abs(x) <= LARGEST for x in numbers):
            self._fail(f"{field} needs {count} finite numbers of at most {LARGEST:g}, not {str(list(numbers))[:60]}")
        return numbers

    def _fail(self, what: str) -> None:
        raise ModelError(f"camera {self.name}: {what}.")

    @staticmethod
    def from_fov(name: str, position: Sequence[float], rotation: Sequence[float], fovy: float,
                 size: tuple[int, int] = (640, 480), **fields: Any) -> Camera:  # fmt: skip
        """Make a camera with square pixels and its axis in the picture's centre; fovy: degrees from top to bottom edge.

        fields: link, near, far. Raises: ModelError unless fovy is between 0 and 180.
        """
        if not 0.0 < fovy < 180.0:
            raise ModelError(f"camera {name}: fovy is {fovy}, not between 0 and 180 degrees.")
        width, height = whole_size(size)
        focal = 0.5 * height / math.tan(math.radians(0.5 * fovy))
        return Camera(name, tuple(position), tuple(rotation), (width, height), focal, focal,
                      0.5 * (width - 1), 0.5 * (height - 1), **fields)  # fmt: skip

    def with_(self, **changes: Any) -> Camera:
        """Return a copy with these fields changed."""
        return replace(self, **changes)

    def matrix(self, size: tuple[int, int] | None = None) -> np.ndarray:
        """Intrinsics (3, 3) in pixels for pictures of a size (width, height), by default the camera's own."""
        width, height = self.size if size is None else whole_size(size)
        x, y = width / self.size[0], height / self.size[1]
        return np.array([
            [self.fx * x, 0.0, (self.cx + 0.5) * x - 0.5], [0.0, self.fy * y, (self.cy + 0.5) * y - 0.5], [0.0, 0.0, 1.0]
        ])  # fmt: skip

    def pose(self, pose_of_link: Pose | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,), m, and rotation (3, 3) of the camera's frame in the world.

        Raises: SimulationError when the camera is on a link whose pose is not given.
        """
        position, rotation = np.array(self.position), rotation_matrix(self.rotation)
        if self.link is None:
            return position, rotation
        if pose_of_link is None:
            raise SimulationError(f"camera {self.name} is mounted on {self.link}; give the pose of that link.")
        mount = rotation_matrix(pose_of_link[1])
        return np.asarray(pose_of_link[0], float) + mount @ position, mount @ rotation

    def view(self, pose_of_link: Pose | None = None) -> tuple[float, ...]:
        """World to OpenGL's camera frame (x right, y up, z backward): 16 numbers, column by column."""
        return self._standing if self.link is None else self._view(pose_of_link)

    @cached_property
    def _standing(self) -> tuple[float, ...]:
        return self._view(None)

    def _view(self, pose_of_link: Pose | None) -> tuple[float, ...]:
        position, rotation = self.pose(pose_of_link)
        view = np.eye(4)
        view[:3, :3] = (rotation * (1.0, -1.0, -1.0)).T
        view[:3, 3] = -view[:3, :3] @ position
        return tuple(view.T.ravel().tolist())

    def projection(self, size: tuple[int, int], shift: float = 0.0) -> tuple[float, ...]:
        """OpenGL's camera frame to clip space for pictures of a size (width, height): 16 numbers, column by column.

        shift: pixels by which a renderer shifts pictures to the right and up.
        """
        return _projection(self, tuple(size), shift)

    def depth(self, buffer: np.ndarray) -> np.ndarray:
        """Metres along the optical axis, single precision, from a depth buffer, 0 (near) .. 1 (far, or nothing)."""
        metres = self.near * self.far / (self.far - (self.far - self.near) * buffer.astype(np.float64))
        return np.where(buffer < 1.0, metres, self.far).astype(np.float32)


def look_at(
    position: Sequence[float], target: Sequence[float], up: Sequence[float] = (0.0, 0.0, 1.0)
) -> tuple[float, ...]:
    """Quaternion xyzw of a camera's frame (x right, y down, z forward) that looks from a position at a target, m.

    Raises: ModelError when `up` is parallel to the optical axis.
    """
    forward = np.subtract(target, position).astype(float)
    right = np.cross(forward, up)
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward):
        raise ModelError("a camera cannot look along 'up'; give another direction that is up in the picture.")
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    return tuple(Rotation.from_matrix(axes).as_quat().tolist())


@functools.lru_cache(maxsize=64)
def _projection(camera: Camera, size: tuple[int, int], shift: float) -> tuple[float, ...]:
    width, height = whole_size(size)
    (fx, _, cx), (_, fy, cy), _ = camera.matrix(size).tolist()
    near, far = camera.near, camera.far
    x, y = cx + 0.5 - shift, cy + 0.5 + shift  # position of the axis from the picture's corner
    rows = np.array([
        [2.0 * fx / width, 0.0, 1.0 - 2.0 * x / width, 0.0],
        [0.0, 2.0 * fy / height, 2.0 * y / height - 1.0, 0.0],
        [0.0, 0.0, -(far + near) / (far - near), -2.0 * far * near / (far - near)],
        [0.0, 0.0, -1.0, 0.0],
    ])  # fmt: skip
    return tuple(rows.T.ravel().tolist())


def rotation_matrix(quaternion: Sequence[float] | np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion (4,) xyzw."""
    x, y, z, w = quaternion
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def read_size(text: str) -> tuple[int, int]:
    """Width and height from a text such as 128x96.

    Raises: EmbodieDreamerError for another text.
    """
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if match is None:
        raise EmbodieDreamerError(f"--size {text} is not a width and a height; give two numbers such as 128x96.")
    return int(match[1]), int(match[2])


def whole_size(size: Any) -> tuple[int, int]:
    """Width and height of a picture, checked.

    Raises: ModelError for anything but two integers above 0.
    """
    whole = isinstance(size, Sequence) and all(isinstance(x, int | np.integer) and x > 0 for x in size)
    if not whole or len(size) != 2:
        raise ModelError(f"a picture's size is width and height in pixels, two whole numbers above 0, not {size!r}.")
    return int(size[0]), int(size[1])
