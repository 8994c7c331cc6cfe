"""A table before a camera, a block that moves over it, and lamps whose light on the table is known."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.geometry.hull import hull_points
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import ROBOT, TABLE, Condition
from embodiedreamer_gym.vis_aligner.light import Light, relit
from embodiedreamer_gym.vis_aligner.shadows import Plane

SIZE = 64, 48  # pixels
MATRIX = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
DISTANCE = 1.0  # m from the camera, which looks straight down, to the table
PLANE = Plane(np.array([0.0, 0.0, -1.0]), -DISTANCE)
EDGE = 0.12  # m of the block
LAMPS = np.array([[0.9, 0.1, -0.8], [-0.5, 0.6, -1.2]])  # m, in the camera's frame


def hull() -> np.ndarray:
    """The block's corners (1, 48, 3)."""
    corners = np.stack(np.meshgrid(*([(-EDGE / 2, EDGE / 2)] * 3)), -1).reshape(-1, 3)
    return hull_points(corners)[None]


def view(places: np.ndarray) -> Condition:
    """What a simulator shows of the block at places (T, 3), m over the table's middle; hardly tilted, each time otherwise."""
    projections = np.zeros((len(places), 1, 3, 4))
    tilts = np.column_stack([0.1 * places[:, 0], 0.1 * places[:, 1], np.zeros(len(places))])
    projections[:, 0, :, :3] = MATRIX @ Rotation.from_rotvec(tilts).as_matrix()
    projections[:, 0, :, 3] = (places * (1, 1, -1) + (0, 0, DISTANCE)) @ MATRIX.T
    classes = np.full((len(places), SIZE[1], SIZE[0]), TABLE, np.uint8)
    depth = np.full(classes.shape, DISTANCE, np.float32)
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    for number, (x, y, z) in enumerate(places):
        top = DISTANCE - z - EDGE / 2
        inside = (np.abs((columns - 31.5) / 60 * top - x) < EDGE / 2) & (
            np.abs((rows - 23.5) / 60 * top - y) < EDGE / 2
        )
        classes[number, inside], depth[number, inside] = ROBOT, top
    rgb = np.repeat((60 * classes)[..., None], 3, axis=3)
    return Condition(rgb, classes, depth, (classes == ROBOT).astype(np.uint8), projections.astype(np.float32), hull())


def lamps(strengths: tuple[float, float] = (2.0, 1.0)) -> Light:
    """The true light."""
    return Light(LAMPS, np.array(strengths), PLANE, np.ones(SIZE[::-1], bool), MATRIX)


def board(seed: int = 0) -> np.ndarray:
    """The table without shadows (H, W, 3) uint8."""
    return np.random.default_rng(seed).integers(150, 220, (*SIZE[::-1], 3)).astype(np.uint8)


def filmed(count: int, seed: int = 0, noise: float = 1.0) -> Episode:
    """Photos of the block at random places in the true light."""
    rng = np.random.default_rng([seed, 1])
    condition = view(
        np.column_stack([rng.uniform(-0.3, 0.3, count), rng.uniform(-0.2, 0.2, count), rng.uniform(0.1, 0.4, count)])
    )
    lit = relit(board(), 1.0, lamps().shade(condition))
    frames = np.where((condition.classes == ROBOT)[..., None], 90, lit) + rng.normal(0, noise, lit.shape)
    return Episode("lamps", np.clip(np.round(frames), 0, 255).astype(np.uint8), condition)
