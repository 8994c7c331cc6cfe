"""Visual check of a calibration: the robot's predicted outline over the real frames."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Footage
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View
from embodiedreamer_gym.vis_aligner.farthest_points import spread

WIDE = 480  # pixels, smallest width of one frame in the picture
COLUMNS = 3
OUTLINE, INNER, MARK, SEEN = (40, 230, 40), (255, 190, 40), (255, 60, 60), (60, 160, 255)  # RGB


def overlay(
    body: Body, footage: Footage, view: View, rows: list[int] | None = None, count: int = 6, delay: float = 0.0
) -> np.ndarray:
    """Frames side by side (h, w, 3), uint8 RGB, with predicted outlines: green around the robot, orange between links.

    rows: numbers of the frames; by default `count` that differ most.
    delay: of the pictures, rows.
    Raises: VisionError for a row outside the footage.
    """
    total = len(footage.poses)
    chosen = spread(footage.poses[:, :, :3, 3], count, np.ones(total)).tolist() if rows is None else rows
    for row in chosen:
        if not 0 <= row < total:
            raise VisionError(f"{footage.name} has no frame {row}; it has 0 .. {total - 1}.")
    tiles = []
    for row in chosen:
        late = float(np.clip(row - delay, 0, total - 1))
        before = min(int(late), total - 2) if total > 1 else 0
        share = late - before
        pose = (1.0 - share) * footage.poses[before] + share * footage.poses[min(before + 1, total - 1)]
        tiles.append(draw_outlines(footage.frame(row), body, pose, view, f"{footage.name} {row}"))
    return _tiled(tiles)


def draw_outlines(frame: np.ndarray, body: Body, pose: np.ndarray, view: View, label: str = "") -> np.ndarray:
    """A frame (H, W, 3), enlarged, with the predicted outlines of a body in a pose (P, 4, 4)."""
    factor = max(WIDE / frame.shape[1], 1.0)
    size = (round(frame.shape[1] * factor), round(frame.shape[0] * factor))
    picture = cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC)
    code = draw_parts(view.of_size(size).project(body.at(pose[None])), body.faces, body.part, size)[0][0]
    whole = code > 0
    picture[_edges(code) & ~_edges(whole)] = INNER
    picture[_edges(whole)] = OUTLINE
    if label:
        for shift, colour in ((1, (0, 0, 0)), (0, (255, 255, 255))):
            place = (6 + shift, size[1] - 8 + shift)
            cv2.putText(picture, label, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    return picture


def draw_marks(picture: np.ndarray, marks: Keypoints, view: View) -> np.ndarray:
    """A picture with crosses at the marks (red) and at the projections of their points (blue)."""
    drawn = picture.copy()
    factor = np.array(picture.shape[1::-1]) / view.size
    for pixels, colour in ((marks.pixel, MARK), (view.project(marks.point)[:, :2], SEEN)):
        for x, y in np.rint((pixels + 0.5) * factor - 0.5).astype(int):
            cv2.drawMarker(drawn, (int(x), int(y)), colour, cv2.MARKER_CROSS, 9, 1)
    return drawn


def _edges(code: np.ndarray) -> np.ndarray:
    """Pixels (h, w), bool, that differ from their right or lower neighbour."""
    edges = np.zeros(code.shape, bool)
    edges[:, :-1] |= code[:, :-1] != code[:, 1:]
    edges[:-1] |= code[:-1] != code[1:]
    return edges


def _tiled(tiles: list[np.ndarray]) -> np.ndarray:
    columns = min(COLUMNS, len(tiles))
    empty = np.full_like(tiles[0], 255)
    tiles = tiles + [empty] * (-len(tiles) % columns)
    return np.concatenate([np.concatenate(tiles[k : k + columns], axis=1) for k in range(0, len(tiles), columns)])
