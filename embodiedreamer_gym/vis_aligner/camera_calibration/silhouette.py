"""Silhouettes fitted to the evidence as a whole: slower than outlines, but from further away."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import Figure
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Scene
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import near_loose
from embodiedreamer_gym.vis_aligner.camera_calibration.view import PARAMETERS, POSE, View

CELLS = 40  # across the picture
FINER = 2  # cells of the drawing to one of the comparison
SOFT = 1.5  # cells over which both are smoothed
ROUNDS = 8
DAMPING = (1e-2, 1e-4)  # of the first round, and the least
TRIALS = 4  # of stronger damping in one round
FARTHEST = 4.0  # steps of the finite differences that one round may go
ENOUGH = 2e-4  # fall of the unexplained share below which a round is the last


class Silhouette:
    """The evidence of a scene's few frames on a coarse grid, and how well a view explains it."""

    def __init__(self, scene: Scene, figure: Figure) -> None:
        self._figure, self._body = figure, figure.middle
        self._placed = scene.placed(self._body, few=True)
        self._size = scene.size
        self._grid = (CELLS, max(round(scene.size[1] * CELLS / scene.size[0]), 2))
        self._evidence = np.stack([self._smaller(scene.evidence[k]) for k in scene.few])

    def score(self, view: View) -> float:
        """Correlation, -1 .. 1, of silhouettes and evidence over space and time, loose parts left out."""
        weight = self._weight(view)
        wanted, drawn = _changes(self._evidence, weight), _changes(self._draw(view), weight)
        return float((wanted * drawn).sum() / np.sqrt(max((wanted**2).sum() * (drawn**2).sum(), 1e-12)))

    def fit(self, view: View, free: tuple[str, ...]) -> View:
        """Return the view near a given one that explains most of the evidence.

        free: parameters of the lens that may change beside the pose.
        """
        columns = [PARAMETERS.index(name) for name in (*POSE, *free)]
        damping = DAMPING[0]
        for _ in range(ROUNDS):
            weight = self._weight(view)
            wanted = _changes(self._evidence, weight)
            drawn = _changes(self._draw(view), weight)
            left, residual, gain = _unexplained(wanted, drawn)
            steps = self._steps(view)
            slopes = [self._slope(view, k, steps[k], weight) * gain for k in columns]
            matrix = np.stack([*slopes, drawn.ravel()])
            normal, pull = matrix @ matrix.T, matrix @ residual.ravel()
            now = left
            for _ in range(TRIALS):
                ridge = damping * (np.diag(normal) + 1e-9 * np.trace(normal) + 1e-12)
                change = np.linalg.solve(normal + np.diag(ridge), pull)[:-1]
                whole = np.zeros(len(PARAMETERS))
                whole[columns] = np.clip(change, -FARTHEST, FARTHEST) * steps[columns]
                trial = view.moved(whole)
                now = _unexplained(wanted, _changes(self._draw(trial), weight))[0]
                if now < left:
                    view = trial
                    break
                damping *= 5.0
            if left - now < ENOUGH:
                break
            damping = max(damping / 5.0, DAMPING[1])
        return view

    def _slope(self, view: View, k: int, step: float, weight: np.ndarray) -> np.ndarray:
        """Half the difference of the drawings one step ahead and one back, flat."""
        change = np.zeros(len(PARAMETERS))
        change[k] = step
        return 0.5 * _changes(self._draw(view.moved(change)) - self._draw(view.moved(-change)), weight).ravel()

    def _draw(self, view: View) -> np.ndarray:
        """Share of each cell (k, h, w) that the robot covers, smoothed."""
        return np.stack([self._smaller((code > 0).astype(np.float32)) for code in self._codes(view)[0]])

    def _codes(self, view: View) -> tuple[np.ndarray, np.ndarray, float]:
        """Parts drawn on the finer grid (k, H, W), the vertices seen in its cells, and its focal length."""
        grid = view.of_size((self._grid[0] * FINER, self._grid[1] * FINER))
        seen = grid.see(self._placed)
        return draw_parts(seen, self._body.faces, self._body.part, grid.size)[0], seen, grid.fx

    def _weight(self, view: View) -> np.ndarray:
        """Share of each cell (k, h, w) that is not near to a loose part."""
        if not self._figure.loose.any():
            return np.ones_like(self._evidence)
        codes, seen, focal = self._codes(view)
        blind = [near_loose(c, s, self._figure, self._body, focal) for c, s in zip(codes, seen, strict=True)]
        return 1.0 - np.stack(
            [cv2.resize(b.astype(np.float32), self._grid, interpolation=cv2.INTER_AREA) for b in blind]
        )

    def _smaller(self, picture: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(cv2.resize(picture, self._grid, interpolation=cv2.INTER_AREA), (0, 0), SOFT)

    def _steps(self, view: View) -> np.ndarray:
        """Change of each parameter (11,) that moves the picture by about half a cell."""
        depth = view.see(self._placed[:, ::10])[..., 2]
        away = max(float(np.median(depth)), 0.15)
        cell = 0.6 * self._size[0] / CELLS
        across, around = cell / view.fx, cell / (0.25 * self._size[0])
        lens = [cell / (0.2 * self._size[0])] * 2 + [cell / self._size[0]] * 2 + [0.05]
        return np.array([across, across, around, across * away, across * away, 3.0 * across * away, *lens])


def _changes(pictures: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """What changes over time in pictures (k, h, w), weighted."""
    mean = (pictures * weight).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-3)
    return (pictures - mean) * np.sqrt(weight)


def _unexplained(wanted: np.ndarray, drawn: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Share of the evidence's energy that is left, what is left, and the best gain."""
    gain = float((wanted * drawn).sum() / max((drawn**2).sum(), 1e-6))
    residual = wanted - gain * drawn
    return float((residual**2).sum() / max((wanted**2).sum(), 1e-9)), residual, gain
