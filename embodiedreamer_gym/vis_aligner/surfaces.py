"""Maps from picture to picture of what stands around a camera that moves: a table, which is a plane, and what is far."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.condition import TABLE, Condition


def part_projection(condition: Condition, number: int, kind: int) -> np.ndarray | None:
    """The projection (3, 4) of table or background, by their class, in a frame of a camera that moves; None where it does not show
    or is no part.
    """
    if condition.parts is None or condition.projections is None:
        return None
    parts = condition.parts[number][condition.classes[number] == kind]
    part = int(parts.max(initial=0))
    return condition.projections[number, part - 1].astype(float) if part else None


def table_points(view: Condition, projection: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the table in the world, m, that a view of one frame shows."""
    rows, columns = np.nonzero(view.classes[0] == TABLE)
    depth = np.asarray(view.depth)[0, rows, columns]
    rays = np.stack([columns * depth, rows * depth, depth])
    return np.linalg.solve(projection[:, :3], rays - projection[:, 3:]).T


def on_plane(projection: np.ndarray, height: float) -> np.ndarray:
    """The map (3, 3) from (x, y, 1), m, of a horizontal plane of the world at a height, m, to a picture: pixels times depth."""
    return np.column_stack([projection[:, 0], projection[:, 1], projection[:, 2] * height + projection[:, 3]])


def map_back(before: np.ndarray, now: np.ndarray, height: float | None) -> np.ndarray:
    """The map (3, 3) from the pixels of a picture to those of an earlier one, of projections (3, 4) of the same surroundings.

    height: m, of the plane that they show; None where they are far, so that only turning the camera counts.
    """
    if height is None:
        return before[:, :3] @ np.linalg.inv(now[:, :3])
    return on_plane(before, height) @ np.linalg.inv(on_plane(now, height))


def in_front(back: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) of a picture of a size (width, height) that a map (3, 3) brings before the other camera, not behind it."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return back[2, 0] * columns + back[2, 1] * rows + back[2, 2] > 0


def warped(picture: np.ndarray, matrix: np.ndarray, size: tuple[int, int], how: int) -> np.ndarray:
    """Pixels of a picture at the places to which a map (3, 3) brings those of a picture of a size (width, height).

    how: OpenCV's interpolation; beyond the picture, a mask (nearest) is 0 and colours are those of its edge.
    """
    edge = cv2.BORDER_CONSTANT if how == cv2.INTER_NEAREST else cv2.BORDER_REPLICATE
    return cv2.warpPerspective(picture, matrix, size, flags=how | cv2.WARP_INVERSE_MAP, borderMode=edge)
