"""Edges of the robot's silhouette: as predicted by a view, and as found in the pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import Body, DetailLevels
from embodiedreamer_gym.geometry.rasterizer import NEAREST, draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
RIM = 3  # pixels along the picture's border without edge points
SMOOTH = 1.5  # pixels, standard deviation of the smoothing from which normals are taken
FAINT = 0.02  # smallest gradient of the smoothed mask at which a normal is defined
REACH = 1.5  # pixels to either side over which a step is measured
STEP = 0.5  # pixels between samples along the normal
DOUBT = 0.7  # standard deviation, in search ranges, of the Gaussian weight that prefers near steps


@dataclass(frozen=True, eq=False)
class Outline:
    """Predicted edge points of the robot in several pictures.

    frame: number of the picture (N,).
    part: of the body (N,).
    point: in the world (N, 3), m.
    pixel: projection (N, 2).
    normal: unit vector in the picture, away from the robot (N, 2).
    """

    frame: np.ndarray
    part: np.ndarray
    point: np.ndarray
    pixel: np.ndarray
    normal: np.ndarray

    def __len__(self) -> int:
        return len(self.frame)

    def of(self, which: np.ndarray) -> Outline:
        """A subset of the points, by number or bool."""
        return Outline(self.frame[which], self.part[which], self.point[which], self.pixel[which], self.normal[which])


def predict(levels: DetailLevels, vertices: np.ndarray, view: View) -> Outline:
    """Predict the edge points of the fine body at vertices (T, V, 3), m, in T pictures; none near loose parts."""
    body = levels.fine
    seen = view.project(vertices)
    codes, depths = draw_parts(seen, body.faces, body.part, view.size)
    rows: list[np.ndarray] = []
    for t, (code, depth) in enumerate(zip(codes, depths, strict=True)):
        i, j, normal = _silhouette_border(code, near_loose(code, seen[t], levels, body, view.fx))
        rows.append(np.column_stack([np.full(len(i), t), code[j, i] - 1.0, i, j, normal, depth[j, i]]))
    table = np.concatenate(rows)
    normal = table[:, 4:6]  # the middle of an outermost pixel lies inside by 0 .. its larger part, evenly
    pixel = table[:, 2:4] + 0.5 * np.abs(normal).max(axis=1, initial=0.0, keepdims=True) * normal
    frame, part = table[:, :2].astype(int).T
    return Outline(frame, part, view.unproject(pixel, table[:, 6]), pixel, normal)


def find_steps(outline: Outline, foreground: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Match each point to the strongest edge of the foreground along its normal.

    foreground: (T, H, W), 0..1; reach: search range to either side, pixels.
    Returns distance (N,), pixels, and strength of the edge (N,), 0..1.
    """
    ways = np.arange(-reach, reach + 0.5 * STEP, STEP)
    aside = round(REACH / STEP)
    longer = np.arange(len(ways) + 2 * aside) * STEP - reach - REACH
    distance, strength = np.zeros(len(outline)), np.zeros(len(outline))
    falloff = np.exp(-0.5 * (ways / (DOUBT * reach)) ** 2)
    for t in np.unique(outline.frame):
        own = outline.frame == t
        at = outline.pixel[own][:, None, :] + outline.normal[own][:, None, :] * longer[None, :, None]
        column, row = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
        profile = cv2.remap(foreground[t], column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        step = profile[:, : -2 * aside] - profile[:, 2 * aside :]
        best = (step * falloff).argmax(axis=1)
        rows = np.arange(len(best))
        distance[own] = ways[best] + STEP * _subpixel_peak(step, rows, best)
        strength[own] = np.clip(step[rows, best], 0.0, 1.0)
    return distance, strength


def near_loose(code: np.ndarray, seen: np.ndarray, levels: DetailLevels, body: Body, focal: float) -> np.ndarray:
    """Mask (H, W) of pixels on loose parts or within the margin around them.

    code: part + 1, or 0 (H, W); seen: projected vertices (V, 3), pixels and depth in m; focal: pixels.
    """
    if not levels.loose.any():
        return np.zeros(code.shape, bool)
    mask = np.r_[False, levels.loose][code]
    depth = seen[levels.loose[body.part], 2]
    depth = depth[depth > NEAREST]
    if not len(depth) or not mask.any():
        return mask
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    return away <= levels.margin * focal / float(np.median(depth))


def _subpixel_peak(values: np.ndarray, rows: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Offset (N,), columns, of the maximum of a parabola through each row's best value and its neighbours."""
    left, middle, right = (values[rows, np.clip(best + k, 0, values.shape[1] - 1)] for k in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    return np.where(bend < -1e-6, np.clip(0.5 * (left - right) / np.minimum(bend, -1e-6), -1.0, 1.0), 0.0)


def _silhouette_border(code: np.ndarray, blind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (k,) and rows (k,) of half of the silhouette's outermost pixels, and their outward normals (k, 2)."""
    mask = (code > 0).astype(np.uint8)
    edge = (mask > cv2.erode(mask, CROSS, borderValue=1)) & ~blind
    edge[:RIM], edge[-RIM:], edge[:, :RIM], edge[:, -RIM:] = False, False, False, False
    j, i = np.nonzero(edge)
    # every other pixel, by a hash that favours no side
    keep = (i * 0x9E3779B1 ^ j * 0x85EBCA6B) >> 15 & 1 > 0
    i, j = i[keep], j[keep]
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), SMOOTH)
    slope = np.column_stack([soft[j, i - 1] - soft[j, i + 1], soft[j - 1, i] - soft[j + 1, i]])
    length = np.linalg.norm(slope, axis=1)
    good = length > FAINT
    return i[good], j[good], slope[good] / length[good, None]
