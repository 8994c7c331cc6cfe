"""The edge of a robot's silhouette: where a view predicts it, and where the picture has it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import Body, Figure
from embodiedreamer_gym.geometry.rasterizer import NEAREST, draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
RIM = 3  # pixels along the picture's border where no outline is looked for
SMOOTH = 1.5  # pixels over which its direction is taken
FAINT = 0.02  # of the smoothed mask's slope: a speck, which has no direction
REACH = 1.5  # pixels to either side over which a step is measured
STEP = 0.5  # pixels between two places tried
DOUBT = 0.7  # of the reach: standard deviation by which far steps count less when one is chosen


@dataclass(frozen=True, eq=False)
class Outline:
    """Places on the outline of the robot in several pictures.

    frame (N,): which picture; part (N,): of the body; point (N, 3): m; pixel (N, 2): where the view sees it; normal
    (N, 2): away from the robot.
    """

    frame: np.ndarray
    part: np.ndarray
    point: np.ndarray
    pixel: np.ndarray
    normal: np.ndarray

    def __len__(self) -> int:
        return len(self.frame)

    def of(self, which: np.ndarray) -> Outline:
        """Return some of the places."""
        return Outline(self.frame[which], self.part[which], self.point[which], self.pixel[which], self.normal[which])


def predict(figure: Figure, placed: np.ndarray, view: View) -> Outline:
    """Find the outline of a figure's fine body placed (T, V, 3), m, in T pictures; none near loose parts."""
    body = figure.fine
    seen = view.see(placed)
    codes, depths = draw_parts(seen, body.faces, body.part, view.size)
    rows: list[np.ndarray] = []
    for t, (code, depth) in enumerate(zip(codes, depths, strict=True)):
        i, j, normal = _border(code, near_loose(code, seen[t], figure, body, view.fx))
        rows.append(np.column_stack([np.full(len(i), t), code[j, i] - 1.0, i, j, normal, depth[j, i]]))
    table = np.concatenate(rows)
    normal = table[:, 4:6]  # the middle of an outermost pixel lies inside by 0 .. its larger part, evenly
    pixel = table[:, 2:4] + 0.5 * np.abs(normal).max(axis=1, initial=0.0, keepdims=True) * normal
    frame, part = table[:, :2].astype(int).T
    return Outline(frame, part, view.place(pixel, table[:, 6]), pixel, normal)


def find_steps(outline: Outline, evidence: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Where along its normal each place finds the robot end: distance (N,), pixels, and how clearly (N,), 0 .. 1.

    evidence (T, H, W): 0 .. 1, how surely the robot covers a pixel; reach: pixels to either side.
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
        profile = cv2.remap(evidence[t], column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        step = profile[:, : -2 * aside] - profile[:, 2 * aside :]
        best = (step * falloff).argmax(axis=1)
        rows = np.arange(len(best))
        distance[own] = ways[best] + STEP * _summit(step, rows, best)
        strength[own] = np.clip(step[rows, best], 0.0, 1.0)
    return distance, strength


def near_loose(code: np.ndarray, seen: np.ndarray, figure: Figure, body: Body, focal: float) -> np.ndarray:
    """Pixels (H, W), bool, of the loose parts of what is drawn, or nearer to them than the figure's margin.

    code (H, W): part + 1; seen (V, 3): vertices of the body in pixels and depth, m; focal: pixels.
    """
    if not figure.loose.any():
        return np.zeros(code.shape, bool)
    mask = np.r_[False, figure.loose][code]
    depth = seen[figure.loose[body.part], 2]
    depth = depth[depth > NEAREST]
    if not len(depth) or not mask.any():
        return mask
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    return away <= figure.margin * focal / float(np.median(depth))


def _summit(values: np.ndarray, rows: np.ndarray, best: np.ndarray) -> np.ndarray:
    """How far from the best column (N,) of values (N, k) the summit of a parabola through its neighbours is, columns."""
    left, middle, right = (values[rows, np.clip(best + k, 0, values.shape[1] - 1)] for k in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    return np.where(bend < -1e-6, np.clip(0.5 * (left - right) / np.minimum(bend, -1e-6), -1.0, 1.0), 0.0)


def _border(code: np.ndarray, blind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (k,) and rows (k,) of the outermost pixels of what is drawn, and the direction (k, 2) away from it."""
    mask = (code > 0).astype(np.uint8)
    edge = (mask > cv2.erode(mask, CROSS, borderValue=1)) & ~blind
    edge[:RIM], edge[-RIM:], edge[:, :RIM], edge[:, -RIM:] = False, False, False, False
    j, i = np.nonzero(edge)
    # every other one, without a pattern that would favour a side
    keep = (i * 0x9E3779B1 ^ j * 0x85EBCA6B) >> 15 & 1 > 0
    i, j = i[keep], j[keep]
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), SMOOTH)
    slope = np.column_stack([soft[j, i - 1] - soft[j, i + 1], soft[j - 1, i] - soft[j + 1, i]])
    length = np.linalg.norm(slope, axis=1)
    good = length > FAINT
    return i[good], j[good], slope[good] / length[good, None]
