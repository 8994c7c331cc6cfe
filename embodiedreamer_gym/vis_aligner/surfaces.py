"""Maps between pictures of a moving camera: of the table, which is a plane, and of the far background."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.condition import TABLE, Condition


def part_projection(condition: Condition, number: int, kind: int) -> np.ndarray | None:
    """The projection (3, 4) of the table or the background (kind) in frame `number` of a camera that moves.

    None if it is not visible or not a part.
    """
    if condition.parts is None or condition.projections is None:
        return None
    parts = condition.parts[number][condition.classes[number] == kind]
    part = int(parts.max(initial=0))
    return condition.projections[number, part - 1].astype(float) if part else None


def table_points(view: Condition, projection: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the table, m in the world, that a view (T = 1) shows."""
    rows, columns = np.nonzero(view.classes[0] == TABLE)
    depth = np.asarray(view.depth)[0, rows, columns]
    rays = np.stack([columns * depth, rows * depth, depth])
    return np.linalg.solve(projection[:, :3], rays - projection[:, 3:]).T


def on_plane(projection: np.ndarray, height: float) -> np.ndarray:
    """The map (3, 3) from points (x, y, 1), m, of a horizontal plane at a height, m, to (u, v, 1) depth."""
    return np.column_stack([projection[:, 0], projection[:, 1], projection[:, 2] * height + projection[:, 3]])


def map_back(before: np.ndarray, now: np.ndarray, height: float | None) -> np.ndarray:
    """The map (3, 3) from a picture's pixels to those of an earlier one, from both projections (3, 4) of a surface.

    height: m, of the surface if it is a plane; None if it is far away, so that only the camera's rotation matters.
    """
    if height is None:
        return before[:, :3] @ np.linalg.inv(now[:, :3])
    return on_plane(before, height) @ np.linalg.inv(on_plane(now, height))


def in_front(back: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) of a picture of a size (width, height) that a map (3, 3) moves in front of the other camera."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return back[2, 0] * columns + back[2, 1] * rows + back[2, 2] > 0


def warped(picture: np.ndarray, matrix: np.ndarray, size: tuple[int, int], how: int) -> np.ndarray:
    """A picture warped to a size (width, height); matrix (3, 3): maps the new pixels to those of the picture.

    how: OpenCV's interpolation. Outside the picture, a mask (nearest) is 0, and colours are those of the edge.
    """
    edge = cv2.BORDER_CONSTANT if how == cv2.INTER_NEAREST else cv2.BORDER_REPLICATE
    return cv2.warpPerspective(picture, matrix, size, flags=how | cv2.WARP_INVERSE_MAP, borderMode=edge)
