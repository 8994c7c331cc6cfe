"""A picture's rigid parts carried to where the simulator has moved them: what a link looked like, it looks like again."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.clip import Condition

LEVELS = 2  # of 255, up to which a simulated colour counts as the same
STILL = 0.05  # pixels by which a part may move and still count as standing
PROBE = 0.1  # m from a part's origin to the points by which its motion is told
NEAR = 0.015  # m between two depths of one point of a part


def differs(before: Condition, condition: Condition) -> np.ndarray:
    """Pixels (T, H, W) at which a simulated frame shows something else than another (T = 1), or the same elsewhere."""
    colours = np.abs(condition.rgb.astype(np.int16) - before.rgb).max(axis=3) > LEVELS
    found = colours | (condition.classes != before.classes)
    if condition.parts is not None and before.parts is not None:
        found |= (condition.parts != before.parts) | _of_parts(_moved(before, condition), condition.parts)
    return found


def carry(picture: np.ndarray, before: Condition, condition: Condition) -> tuple[np.ndarray, np.ndarray]:
    """Colours (T, H, W, 3) float32 of parts that have moved, from a picture (H, W, 3) of another instant; where (T, H, W).

    before (T = 1): what the simulator showed at that instant. A pixel is carried where its point of the part was in view.
    """
    out, carried = np.zeros(condition.rgb.shape, np.float32), np.zeros(condition.classes.shape, bool)
    if condition.parts is None or condition.projections is None or before.parts is None or before.projections is None:
        return out, carried
    times, rows, columns = np.nonzero(_of_parts(_moved(before, condition), condition.parts))
    if not len(times):
        return out, carried
    parts = condition.parts[times, rows, columns]
    turn, shift = _between(before.projections[0], condition.projections)
    depths = _depth(condition)[times, rows, columns]
    rays = np.stack([columns, rows, np.ones(len(rows))], 1) * depths[:, None]
    points = np.einsum("nij,nj->ni", turn[times, parts - 1], rays) + shift[times, parts - 1]
    away = np.maximum(points[:, 2], 1e-3)
    u, v = points[:, 0] / away, points[:, 1] / away
    height, width = picture.shape[:2]
    i, j = np.round(v).astype(int).clip(0, height - 1), np.round(u).astype(int).clip(0, width - 1)
    seen = (np.abs(u - j) <= 0.51) & (np.abs(v - i) <= 0.51) & (before.parts[0, i, j] == parts)
    seen &= np.abs(_depth(before)[0, i, j] - points[:, 2]) < NEAR
    here = (times[seen], rows[seen], columns[seen])
    place = (u[seen].astype(np.float32)[:, None], v[seen].astype(np.float32)[:, None])
    if len(place[0]):
        out[here] = _sampled(picture.astype(np.float32), *place)
        carried[here] = True
    return out, carried


def _sampled(picture: np.ndarray, u: np.ndarray, v: np.ndarray, most: int = 30000) -> np.ndarray:
    """Colours (n, 3) between pixels; OpenCV takes no more than 32767 rows at once."""
    spans = range(0, len(u), most)
    taken = [cv2.remap(picture, u[s : s + most], v[s : s + most], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
             for s in spans]  # fmt: skip
    return np.concatenate(taken)[:, 0]


def _between(before: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, L, 3, 3) and (T, L, 3): from a ray times depth in a frame to the same point of the part in another picture."""
    back = before[:, :, :3].astype(float) @ np.linalg.inv(now[..., :3].astype(float))
    return back, before[:, :, 3] - np.einsum("tlij,tlj->tli", back, now[..., 3].astype(float))


def _moved(before: Condition, condition: Condition) -> np.ndarray:
    """Whether each part (T, L) stands elsewhere in the picture."""
    probes = np.concatenate([np.zeros((1, 3)), PROBE * np.eye(3)])
    probes = np.concatenate([probes, np.ones((4, 1))], 1).T  # (4, 4)
    then, now = (np.asarray(c.projections, float) @ probes for c in (before, condition))
    then, now = (p[..., :2, :] / np.maximum(np.abs(p[..., 2:, :]), 1e-3) for p in (then, now))
    return np.abs(then - now).max(axis=(2, 3)) > STILL


def _of_parts(which: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Pixels (T, H, W) of these parts (T, L)."""
    table = np.concatenate([np.zeros((len(which), 1), bool), which], 1)
    return np.take_along_axis(table, parts.reshape(len(parts), -1).astype(np.intp), 1).reshape(parts.shape)


def _depth(condition: Condition) -> np.ndarray:
    return np.zeros(condition.classes.shape) if condition.depth is None else condition.depth
