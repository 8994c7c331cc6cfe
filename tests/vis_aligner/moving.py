"""A painted table and a wall far behind it, before a camera that moves; a board hangs before the camera as a hand does."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.geometry.camera import look_at
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, OBJECT, ROBOT, TABLE, Condition

WIDTH, HEIGHT, FOCAL = 64, 48, 55.0
MATRIX = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
TOP, EDGE, FAR = 0.7, 0.6, 5.0  # m: height of the table, its far edge, what is nowhere
HAND, WORLD, WALL, CUP = 1, 2, 3, 4  # parts
CUP_AT, CUP_SIDE = np.array([0.3, 0.05, TOP + 0.001]), 0.03  # m, a square mark that lies on the table


def pose(x: float, y: float, ahead: float = 0.15) -> tuple[np.ndarray, np.ndarray]:
    """Position and axes of a camera 0.25 m above the table that looks forward and down."""
    position = np.array([x, y, TOP + 0.25])
    return position, Rotation.from_quat(look_at(position, position + np.array([ahead, 0.02, -0.2]))).as_matrix()


def paint(points: np.ndarray) -> np.ndarray:
    """Colours (3, n) of the table at points (3, n)."""
    x, y = points[:2]
    return np.stack([120 + 60 * np.sin(30 * x), 120 + 60 * np.cos(25 * y), 120 + 40 * np.sin(20 * (x + y))])


def scene(places: list[tuple[float, float]], exposure: float = 1.0, name: str = "one") -> Episode:
    """What the camera at these places films, and what a simulator shows of it."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.linalg.inv(MATRIX) @ np.stack([columns, rows, np.ones_like(rows)]).reshape(3, -1)
    frames, fields = [], {key: [] for key in ("rgb", "classes", "depth", "parts", "projections")}
    for x, y in places:
        position, axes = pose(x, y)
        ahead = axes @ rays
        depth = np.where(ahead[2] < -1e-6, (TOP - position[2]) / np.minimum(ahead[2], -1e-6), FAR)
        points = position[:, None] + ahead * depth
        table = (depth < FAR) & (points[0] < EDGE)
        depth = np.where(table, depth, FAR)
        cup = table & (np.abs(points[:2] - CUP_AT[:2, None]) < CUP_SIDE).all(axis=0)
        hand = (rows.reshape(-1) > HEIGHT - 10) & (np.abs(columns.reshape(-1) - WIDTH / 2) > 14)
        wall = 128 + 90 * np.sin(6 * np.arctan2(ahead[1], ahead[0])) * np.ones((3, 1))
        colours = np.where(table, paint(points), wall)
        colours = np.where(cup, np.array([[200], [60 + 0.0], [60]]) + 900 * (points[1] - CUP_AT[1]), colours)
        wide = cv2.dilate(hand.reshape(HEIGHT, WIDTH).astype(np.uint8), np.ones((3, 3), np.uint8)).reshape(-1) > 0
        colours = np.where(wide, 30, exposure * colours)  # as a lens' distortion may show it
        frames.append(np.clip(colours, 0, 255).T.reshape(HEIGHT, WIDTH, 3).astype(np.uint8))
        classes = np.where(hand, ROBOT, np.where(cup, OBJECT, np.where(table, TABLE, 0)))
        parts = np.where(hand, HAND, np.where(cup, CUP, np.where(table, WORLD, WALL)))
        world = MATRIX @ axes.T @ np.column_stack([np.eye(3), -position])
        far = world * np.array([1, 1, 1, 0])
        held = MATRIX @ np.column_stack([np.eye(3), [0, 0, 0.2]])
        mark = world @ np.block([[np.eye(3), CUP_AT[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
        fields["rgb"].append(np.repeat(40 * parts[:, None], 3, axis=1).reshape(HEIGHT, WIDTH, 3).astype(np.uint8))
        fields["classes"].append(classes.reshape(HEIGHT, WIDTH).astype(np.uint8))
        fields["depth"].append(np.where(hand, 0.2, depth).reshape(HEIGHT, WIDTH).astype(np.float32))
        fields["parts"].append(parts.reshape(HEIGHT, WIDTH).astype(np.uint8))
        fields["projections"].append(np.stack([held, world, far, mark]).astype(np.float32))
    names = (*CLASS_NAMES[:OBJECT], "mark")
    return Episode(name, np.stack(frames), Condition(**{k: np.stack(v) for k, v in fields.items()}), class_names=names)
