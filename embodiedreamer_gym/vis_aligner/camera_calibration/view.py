"""Camera model of a fit: pose and intrinsics, projection and its Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.geometry.rasterizer import NEAREST

POSE = ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")
LENS = ("focal", "aspect", "cx", "cy", "k1")
PARAMETERS = POSE + LENS
UNDISTORT_STEPS = 10  # fixed-point iterations
MAX_TANGENT_SQUARED = 4.0  # squared tangent above which distortion is held constant, so that projection stays injective


@dataclass(frozen=True, eq=False)
class View:
    """A pinhole camera with radial distortion.

    rotation (3, 3), translation (3,), m: from the world's frame to the camera's (x right, y down, z forward).
    fx, fy, cx, cy: pixels, for pictures of `size`.
    size: width and height.
    k1: radial distortion as in OpenCV.
    A change (11,) has the order of PARAMETERS: rotation vector, rad, and translation, m, in the camera's frame;
    logarithms of focal length and of fy / fx; cx and cy in widths of the picture; k1.
    """

    rotation: np.ndarray
    translation: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int]
    k1: float = 0.0

    @staticmethod
    def from_camera(camera: Camera, size: tuple[int, int] | None = None, k1: float = 0.0) -> View:
        """The view of a camera fixed in the world; size: of the pictures, by default the camera's."""
        position, rotation = camera.pose()
        view = View(rotation.T, -rotation.T @ position, camera.fx, camera.fy, camera.cx, camera.cy, camera.size, k1)
        return view if size is None else view.of_size(size)

    @staticmethod
    def from_pose(
        position: np.ndarray, rotation: np.ndarray, focal: float, size: tuple[int, int], aspect: float = 1.0
    ) -> View:
        """A view with the principal point at the picture's centre.

        position: (3,), m; rotation: from the world's frame to the camera's (3, 3); focal: pixels.
        """
        middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        return View(rotation, -rotation @ position, focal, focal * aspect, *middle, size)

    def of_size(self, size: tuple[int, int]) -> View:
        """The same view for pictures of another size (width, height)."""
        x, y = size[0] / self.size[0], size[1] / self.size[1]
        return replace(self, fx=self.fx * x, fy=self.fy * y, cx=(self.cx + 0.5) * x - 0.5, cy=(self.cy + 0.5) * y - 0.5,
                       size=size)  # fmt: skip

    @property
    def position(self) -> np.ndarray:
        """Position of the camera in the world (3,), m."""
        return -self.rotation.T @ self.translation

    @property
    def aspect(self) -> float:
        """Ratio of the focal lengths, fy / fx."""
        return self.fy / self.fx

    def camera(self, name: str) -> Camera:
        """The pinhole camera, without distortion."""
        rotation = Rotation.from_matrix(self.rotation.T).as_quat()
        return Camera(name, tuple(self.position.tolist()), tuple(rotation.tolist()), self.size,
                      self.fx, self.fy, self.cx, self.cy)  # fmt: skip

    def updated(self, change: Sequence[float] | np.ndarray) -> View:
        """The view after a change (11,)."""
        x = np.asarray(change, float)
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        fx = self.fx * float(np.exp(x[6]))
        whole = turn @ self.rotation
        left, _, right = np.linalg.svd(whole)  # orthonormal again: rounding errors accumulate
        width = self.size[0]
        return replace(
            self, rotation=left @ right, translation=turn @ self.translation + x[3:6], fx=fx, fy=fx * self.aspect * float(np.exp(x[7])),
            cx=self.cx + width * float(x[8]), cy=self.cy + width * float(x[9]), k1=self.k1 + float(x[10]),
        )  # fmt: skip

    def project(self, points: np.ndarray) -> np.ndarray:
        """Column and row, pixels, and depth, m (..., 3), of points (..., 3), m, in the precision of the input.

        Points less than 2 cm in front of the camera get pixels far outside the picture.
        """
        kind = points.dtype
        seen = points @ self.rotation.T.astype(kind) + self.translation.astype(kind)
        depth = seen[..., 2]
        good = depth > NEAREST
        plane = seen[..., :2] / np.where(good, depth, 1.0)[..., None]
        if self.k1:
            plane *= 1.0 + self.k1 * np.minimum(np.einsum("...i,...i", plane, plane), MAX_TANGENT_SQUARED)[..., None]
        seen[..., 0] = np.where(good, plane[..., 0] * self.fx + self.cx, -1e5)
        seen[..., 1] = np.where(good, plane[..., 1] * self.fy + self.cy, -1e5)
        return seen

    def unproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Points in the world (N, 3), m, at pixels (N, 2) and depths (N,), m."""
        bent = (np.asarray(pixels, float) - [self.cx, self.cy]) / [self.fx, self.fy]
        plane = bent
        for _ in range(UNDISTORT_STEPS if self.k1 else 0):
            plane = bent / (1.0 + self.k1 * np.minimum((plane**2).sum(axis=1), MAX_TANGENT_SQUARED))[:, None]
        seen = np.column_stack([plane, np.ones(len(plane))]) * np.asarray(depth, float)[:, None]
        return (seen - self.translation) @ self.rotation

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative (N, 2, 11) of the projection of points (N, 3), m, by a change."""
        seen = np.asarray(points, float) @ self.rotation.T + self.translation
        x, y, z = seen.T
        u, v = x / z, y / z
        radius = np.minimum(u * u + v * v, MAX_TANGENT_SQUARED)
        bend, push = 1.0 + self.k1 * radius, np.where(radius < MAX_TANGENT_SQUARED, 2.0 * self.k1, 0.0)
        out = np.zeros((len(seen), 2, len(PARAMETERS)))
        place = np.zeros((len(seen), 2, 3))  # of the undistorted projection by the point in the camera's frame
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
