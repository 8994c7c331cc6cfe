"""Space carving: the shape of what moves with a link in recordings, from a block of voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration import Footage
from embodiedreamer_gym.vis_aligner.farthest_points import spread

VOXEL = 0.01  # m, edge of a voxel
SHARE = 0.75  # share of a voxel's views above which it is kept: views with something moving at its place
REACH = 0.2  # m from the link's origin to the sides of the block
VIEWS = 60  # of a recording, those in which the link's poses differ most
FEWEST = 0.25  # smallest share of all views in which a voxel must be inside the picture
MOVING = 28  # of 255: a pixel moves if a channel differs by more than this from the median of the views
STILL = 0.005  # m: a link that moves less cannot be distinguished from the background
NEAREST = 0.05  # m in front of the camera
PROBE = 0.1  # m from the link's origin to the points that measure its motion
SMALLEST = 8  # voxels


@dataclass(frozen=True, eq=False)
class CarvedShape:
    """What moves with a link.

    vertices (V, 3): m, in the link's frame; faces (F, 3): triangles, anticlockwise seen from outside; colour (3,): RGB
    of 255, the median of its pixels; voxels: number of voxels in it.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colour: np.ndarray
    voxels: int

    def __repr__(self) -> str:
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        size = " x ".join(f"{100 * edge:.0f}" for edge in high - low)
        return f"CarvedShape({self.voxels} voxels, {size} cm)"


def carve(footage: Sequence[Footage], cameras: Sequence[Camera], reach: float = REACH) -> CarvedShape:
    """The shape around a link: voxels at which something moving is seen in more than SHARE of their views.

    footage: with poses (T, 1, 4, 4) of the link alone; cameras: of each recording; reach: half the block's edge, m.
    Raises: VisionError where the link moves in no recording, or nothing moves with it.
    """
    block = _block(reach)
    points = block.reshape(-1, 3)
    hits, seen, views = np.zeros(len(points), int), np.zeros(len(points), int), []
    for one, camera in zip(footage, cameras, strict=True):
        rows = _differing(one)
        if len(rows) < 2:
            continue
        pictures = np.stack([one.frame(row) for row in rows])
        moving = np.abs(pictures - np.median(pictures, axis=0)).max(axis=3) > MOVING
        matrices = _projections(one.poses[rows, 0], camera, one.size)
        for mask, matrix in zip(moving, matrices, strict=True):
            inside, u, v = _pixels(points, matrix, mask.shape)
            hits[inside] += mask[v, u]
            seen[inside] += 1
        views.append((pictures, moving, matrices))
    total = sum(len(moving) for _, moving, _ in views)
    if not total:
        raise VisionError("the link moves in none of the recordings; give recordings in which it does.")
    kept = ((seen >= FEWEST * total) & (hits > SHARE * seen)).reshape(block.shape[:3])
    kept = _largest(kept)
    if kept.sum() < SMALLEST:
        raise VisionError(
            f"nothing is seen to move with the link within {reach:g} m of it in {total} views; check camera and joints "
            "with the pictures of `vis camera --overlay`."
        )
    vertices, faces = _surface(kept)
    colours = []
    for pictures, moving, matrices in views:
        for picture, mask, matrix in zip(pictures, moving, matrices, strict=True):
            _, u, v = _pixels(block[kept], matrix, mask.shape)
            colours.append(picture[v, u][mask[v, u]])
    colour = np.median(np.concatenate(colours), axis=0)
    return CarvedShape(block[0, 0, 0] + VOXEL * (vertices - 0.5), faces, colour, int(kept.sum()))


def _block(reach: float) -> np.ndarray:
    """Middles (N, N, N, 3) of voxels around the origin, m."""
    steps = VOXEL * np.arange(-round(reach / VOXEL), round(reach / VOXEL) + 1)
    return np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)


def _differing(footage: Footage) -> np.ndarray:
    """Rows of a recording in which the link's poses differ most; none if it does not move."""
    pose = footage.poses[:, 0]
    probes = np.concatenate([pose[:, None, :3, 3], pose[:, None, :3, 3] + PROBE * pose[:, :3, :3].swapaxes(1, 2)], 1)
    if np.ptp(probes, axis=0).max() < STILL:
        return np.zeros(0, int)
    return spread(probes, VIEWS, np.ones(len(probes)))


def _projections(poses: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Projections (T, 3, 4) of poses (T, 4, 4): (u, v, 1) depth = projection (x, y, z, 1), m to pixels."""
    position, rotation = camera.pose()
    to_camera = np.column_stack([rotation.T, -rotation.T @ position])
    return camera.matrix(size) @ to_camera @ poses


def _pixels(points: np.ndarray, matrix: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """Which points (N,) are inside a picture (H, W), and their columns and rows."""
    u, v, depth = matrix[:, :3] @ points.T + matrix[:, 3:]
    depth = np.where(depth > NEAREST, depth, np.inf)
    u, v = np.rint(u / depth).astype(int), np.rint(v / depth).astype(int)
    inside = np.isfinite(depth) & (u >= 0) & (u < shape[1]) & (v >= 0) & (v < shape[0])
    return inside, u[inside], v[inside]


def _largest(kept: np.ndarray) -> np.ndarray:
    """The largest connected piece of voxels (N, N, N)."""
    labels, count = ndimage.label(kept, np.ones((3, 3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    if count == 0:
        return kept
    return labels == 1 + np.argmax(np.bincount(labels.ravel())[1:])


def _surface(kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3), in voxels from the block's corner, and triangles (F, 3) of the sides between kept voxels and others."""
    padded, quads = np.pad(kept, 1), []
    for axis in range(3):
        one, two = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        around = np.array([0 * one, one, one + two, two])
        for side in (0, 1):
            beside = np.roll(padded, 1 - 2 * side, axis)  # the neighbour at the low side, then at the high one
            corner = np.argwhere(padded & ~beside) - 1 + side * np.eye(3, dtype=int)[axis]
            quads.append(corner[:, None] + (around if side else around[::-1]))
    corners = np.concatenate(quads).reshape(-1, 3)
    vertices, number = np.unique(corners, axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    return vertices.astype(float), np.concatenate([number[:, [0, 1, 2]], number[:, [0, 2, 3]]])
