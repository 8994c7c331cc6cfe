"""Pictures of a simulated camera, with their ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture with its ground truth.

    rgb: (H, W, 3) uint8.
    depth: (H, W) float32, m along the optical axis; the camera's `far` where there is nothing.
    segmentation: (H, W) uint8, class numbers; 0 is the background.
    parts: (H, W) uint8, number of the rigid part, from 1; 0 elsewhere. For a camera that moves with a link, table and
    background are two further parts, after the robot's links and before the props.
    projections: (L, 3, 4) float32 of the L parts: (u, v, 1) depth = projection (x, y, z, 1), from m in the part's frame
    to pixels.
    hulls: (L, P, 3) float32, points of each part's convex hull, m in its frame; all zero for a part without a shape;
    none (0, 0, 3) where they are not known.
    """

    rgb: np.ndarray
    depth: np.ndarray
    segmentation: np.ndarray
    parts: np.ndarray
    projections: np.ndarray
    hulls: np.ndarray

    def __repr__(self) -> str:
        return f"Frame({self.rgb.shape[1]} x {self.rgb.shape[0]})"

    def as_dict(self) -> dict[str, np.ndarray]:
        """The arrays by the names that files, `info["clip"]` and a `Condition` use."""
        return {"rgb": self.rgb, "classes": self.segmentation, "depth": self.depth, "parts": self.parts,
                "projections": self.projections, "hulls": self.hulls}  # fmt: skip


def stacked(frames: Sequence[Frame]) -> dict[str, np.ndarray]:
    """Stack frames (at least one) of one world: arrays (T, ...) by the names of `Frame.as_dict`.

    The hulls (L, P, 3) are not stacked; they are left out if they are not known.
    """
    rows = [frame.as_dict() for frame in frames]
    data = {key: np.stack([row[key] for row in rows]) for key in rows[0] if key != "hulls"}
    return data | ({"hulls": frames[0].hulls} if len(frames[0].hulls) else {})


def with_surroundings(frame: Frame, links: int, matrix: np.ndarray, camera_position: np.ndarray,
                      camera_axes: np.ndarray) -> Frame:  # fmt: skip
    """A frame of a moving camera with table and background as further parts, after the first `links` parts.

    The background is treated as infinitely far, so only the camera's rotation moves it in the picture, not its
    translation. For the other arguments see `projections`.
    """
    world = projections(matrix, camera_position, camera_axes, [(np.zeros(3), np.eye(3))])
    far = world * np.array([1, 1, 1, 0], np.float32)
    parts = np.where(frame.parts > links, frame.parts + 2, frame.parts)
    around = (frame.parts == 0) & (frame.segmentation <= 1)
    parts[around] = np.where(frame.segmentation[around] == 1, links + 1, links + 2)
    hulls = frame.hulls
    if len(hulls):
        hulls = np.insert(hulls, [links, links], 0.0, axis=0)
    shown = np.concatenate([frame.projections[:links], world, far, frame.projections[links:]])
    return replace(frame, parts=parts.astype(np.uint8), projections=shown, hulls=hulls)


def projections(matrix: np.ndarray, camera_position: np.ndarray, camera_axes: np.ndarray,
                poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:  # fmt: skip
    """Projections (L, 3, 4), float32, of rigid parts.

    matrix: intrinsics (3, 3); camera_position: (3,) m and camera_axes: (3, 3) of the camera's frame in the world;
    poses: position (3,) m and rotation (3, 3) of each part.
    """
    rows = np.zeros((len(poses), 3, 4))
    world_to_pixels = matrix @ camera_axes.T
    for row, (position, rotation) in zip(rows, poses, strict=True):
        row[:, :3] = world_to_pixels @ rotation
        row[:, 3] = world_to_pixels @ (np.asarray(position) - camera_position)
    return rows.astype(np.float32)
