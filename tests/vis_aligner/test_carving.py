"""What moves with a link is carved out; what does not, is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.envs.cameras import look_at
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration import Footage
from embodiedreamer_gym.vis_aligner.carving import VOXEL, carve

SIZE, ROWS = (96, 72), 40
CAMERA = Camera("top", (1.0, 0.1, 0.5), look_at((1.0, 0.1, 0.5), (0.0, 0.0, 0.2)), SIZE, 90.0, 90.0, 47.5, 35.5)
BOX = np.array([[-0.02, 0.04, 0.02], [0.02, 0.09, 0.12]])  # corners in the link's frame, m


def poses(moving: bool) -> np.ndarray:
    """Poses (T, 1, 4, 4) of a link that turns and wanders, or stands still."""
    rng, placed = np.random.default_rng(2), np.tile(np.eye(4), (ROWS, 1, 1, 1))
    placed[:, 0, :3, 3] = (0.0, 0.0, 0.2)
    if moving:
        placed[:, 0, :3, :3] = Rotation.from_rotvec(rng.uniform(-1.3, 1.3, (ROWS, 3))).as_matrix()
        placed[:, 0, :3, 3] += rng.uniform(-0.22, 0.22, (ROWS, 3))
    return placed


def film(placed: np.ndarray) -> np.ndarray:
    """Frames (T, H, W, 3) of the box, and of something that moves elsewhere."""
    rng, frames = np.random.default_rng(3), np.full((ROWS, SIZE[1], SIZE[0], 3), 170.0)
    points = rng.uniform(*BOX, (20000, 3))
    position, rotation = CAMERA.pose()
    for t, pose in enumerate(placed[:, 0]):
        seen = (points @ pose[:3, :3].T + pose[:3, 3] - position) @ rotation @ CAMERA.matrix(SIZE).T
        u, v = np.rint(seen[:, :2] / seen[:, 2:]).astype(int).T
        inside = (u >= 0) & (u < SIZE[0]) & (v >= 0) & (v < SIZE[1])
        frames[t, v[inside], u[inside]] = (40, 90, 60)
        frames[t, 5:15, 2 * t : 2 * t + 9] = (200, 60, 60)
    return np.clip(frames + rng.normal(0, 2, frames.shape), 0, 255).astype(np.uint8)


def test_a_box_is_found_in_the_frame_of_its_link() -> None:
    shape = carve([Footage(film(poses(True)), poses(True))], [CAMERA])
    assert np.abs(shape.vertices.min(axis=0) - BOX[0]).max() < 1.6 * VOXEL
    assert np.abs(shape.vertices.max(axis=0) - BOX[1]).max() < 1.6 * VOXEL
    assert np.abs(shape.colour - (40, 90, 60)).max() < 6
    a, b, c = shape.vertices[shape.faces].swapaxes(0, 1)
    volume = np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6  # of a closed surface whose triangles face outwards
    assert volume == pytest.approx(shape.voxels * VOXEL**3, rel=1e-6)


def test_what_cannot_be_carved_is_one_sentence() -> None:
    still, moving = poses(False), poses(True)
    with pytest.raises(VisionError, match="moves in none of the recordings"):
        carve([Footage(film(moving), still)], [CAMERA])
    with pytest.raises(VisionError, match="nothing is seen to move with the link"):
        carve([Footage(film(moving)[::-1].copy(), moving)], [CAMERA])
