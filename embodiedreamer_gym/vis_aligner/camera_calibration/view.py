"""What a fit moves: pose and lens of a camera, how points are seen by it, and how that changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.rasterizer import NEAREST

POSE = ("turn_x", "turn_y", "turn_z", "shift_x", "shift_y", "shift_z")
LENS = ("focal", "aspect", "cx", "cy", "k1")
PARAMETERS = POSE + LENS
UNBENDING = 10  # rounds that take distortion off a pixel
WIDEST = 4.0  # squared tangent beyond which k1 bends no further, lest the picture fold back


@dataclass(frozen=True, eq=False)
class View:
    """A camera in a fit.

    turn (3, 3) and shift (3,), m: from the world's frame to the camera's (x right, y down, z forward); fx, fy, cx, cy,
    in pixels, for pictures of a size (width, height); k1: radial distortion as in OpenCV.
    A change (11,) is in PARAMETERS: a rotation vector, rad, and a shift, m, in the camera's frame; logarithms of focal
    length and of fy / fx; cx and cy in widths of the picture; k1.
    """

    turn: np.ndarray
    shift: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int]
    k1: float = 0.0

    @staticmethod
    def of_camera(camera: Camera, size: tuple[int, int] | None = None, k1: float = 0.0) -> View:
        """Make the view of a camera that stands in the world, for pictures of a size, by default its own."""
        position, rotation = camera.pose()
        view = View(rotation.T, -rotation.T @ position, camera.fx, camera.fy, camera.cx, camera.cy, camera.size, k1)
        return view if size is None else view.of_size(size)

    @staticmethod
    def looking(
        position: np.ndarray, turn: np.ndarray, focal: float, size: tuple[int, int], aspect: float = 1.0
    ) -> View:
        """Make a view with its axis in the middle of the picture; position (3,), m."""
        middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        return View(turn, -turn @ position, focal, focal * aspect, *middle, size)

    def of_size(self, size: tuple[int, int]) -> View:
        """Return the same view for pictures of another size (width, height)."""
        x, y = size[0] / self.size[0], size[1] / self.size[1]
        return replace(self, fx=self.fx * x, fy=self.fy * y, cx=(self.cx + 0.5) * x - 0.5, cy=(self.cy + 0.5) * y - 0.5,
                       size=size)  # fmt: skip

    @property
    def position(self) -> np.ndarray:
        """Where the camera is, (3,) m."""
        return -self.turn.T @ self.shift

    @property
    def aspect(self) -> float:
        """Focal length in rows over that in columns."""
        return self.fy / self.fx

    def camera(self, name: str) -> Camera:
        """Return the pinhole camera, without distortion."""
        rotation = Rotation.from_matrix(self.turn.T).as_quat()
        return Camera(name, tuple(self.position.tolist()), tuple(rotation.tolist()), self.size,
                      self.fx, self.fy, self.cx, self.cy)  # fmt: skip

    def moved(self, change: Sequence[float] | np.ndarray) -> View:
        """Return the view after a change (11,)."""
        x = np.asarray(change, float)
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        fx = self.fx * float(np.exp(x[6]))
        whole = turn @ self.turn
        left, _, right = np.linalg.svd(whole)  # rounding adds up over many changes
        width = self.size[0]
        return replace(
            self, turn=left @ right, shift=turn @ self.shift + x[3:6], fx=fx, fy=fx * self.aspect * float(np.exp(x[7])),
            cx=self.cx + width * float(x[8]), cy=self.cy + width * float(x[9]), k1=self.k1 + float(x[10]),
        )  # fmt: skip

    def see(self, points: np.ndarray) -> np.ndarray:
        """Column and row, pixels, and depth, m, (..., 3) of points (..., 3) in m, in their precision.

        Points less than 2 cm before the camera are given the depth they have and a place far outside the picture.
        """
        kind = points.dtype
        seen = points @ self.turn.T.astype(kind) + self.shift.astype(kind)
        depth = seen[..., 2]
        good = depth > NEAREST
        plane = seen[..., :2] / np.where(good, depth, 1.0)[..., None]
        if self.k1:
            plane *= 1.0 + self.k1 * np.minimum(np.einsum("...i,...i", plane, plane), WIDEST)[..., None]
        seen[..., 0] = np.where(good, plane[..., 0] * self.fx + self.cx, -1e5)
        seen[..., 1] = np.where(good, plane[..., 1] * self.fy + self.cy, -1e5)
        return seen

    def place(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Points (N, 3), m, of the world that are seen at pixels (N, 2) in a depth (N,), m."""
        bent = (np.asarray(pixels, float) - [self.cx, self.cy]) / [self.fx, self.fy]
        plane = bent
        for _ in range(UNBENDING if self.k1 else 0):
            plane = bent / (1.0 + self.k1 * np.minimum((plane**2).sum(axis=1), WIDEST))[:, None]
        seen = np.column_stack([plane, np.ones(len(plane))]) * np.asarray(depth, float)[:, None]
        return (seen - self.shift) @ self.turn

    def slopes(self, points: np.ndarray) -> np.ndarray:
        """Derivative (N, 2, 11) of column and row of points (N, 3), m, by a change."""
        seen = np.asarray(points, float) @ self.turn.T + self.shift
        x, y, z = seen.T
        u, v = x / z, y / z
        radius = np.minimum(u * u + v * v, WIDEST)
        bend, push = 1.0 + self.k1 * radius, np.where(radius < WIDEST, 2.0 * self.k1, 0.0)
        out = np.zeros((len(seen), 2, len(PARAMETERS)))
        place = np.zeros((len(seen), 2, 3))  # of the undistorted point by the point in the camera's frame
        place[:, 0, 0] = place[:, 1, 1] = 1.0 / z
        place[:, 0, 2], place[:, 1, 2] = -u / z, -v / z
        plane = np.stack([u, v], axis=1)
        by_plane = bend[:, None, None] * np.eye(2) + push[:, None, None] * plane[:, :, None] * plane[:, None, :]
        by_point = np.array([self.fx, self.fy])[:, None] * (by_plane @ place)
        zero = np.zeros_like(x)
        spin = np.stack([np.stack([zero, z, -y], 1), np.stack([-z, zero, x], 1), np.stack([y, -x, zero], 1)], axis=1)
        out[:, :, :3], out[:, :, 3:6] = by_point @ spin, by_point
        out[:, 0, 6], out[:, 1, 6] = self.fx * u * bend, self.fy * v * bend
        out[:, 1, 7] = self.fy * v * bend
        out[:, 0, 8] = out[:, 1, 9] = self.size[0]
        out[:, 0, 10], out[:, 1, 10] = self.fx * u * radius, self.fy * v * radius
        return out
