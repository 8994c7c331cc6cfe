"""Region-based fit of silhouettes to the foreground: slower than edges, with a wider basin of convergence."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import near_loose
from embodiedreamer_gym.vis_aligner.camera_calibration.view import PARAMETERS, POSE, View

CELLS = 40  # of the grid across the picture
FINER = 2  # cells of the drawn silhouette per cell of the grid
SOFT = 1.5  # cells, standard deviation of the smoothing
ROUNDS = 8  # Levenberg-Marquardt steps
DAMPING = (1e-2, 1e-4)  # initial and smallest damping
TRIALS = 4  # increases of the damping in one step
FARTHEST = 4.0  # largest step, in steps of the finite differences
ENOUGH = 2e-4  # decrease of the residual energy below which the fit ends


class Silhouette:
    """The foreground of a search's frames on a coarse grid, and the agreement of views with it."""

    def __init__(self, scene: Observations, levels: DetailLevels) -> None:
        self._levels, self._body = levels, levels.middle
        self._vertices = scene.vertices(self._body, few=True)
        self._size = scene.size
        self._grid = (CELLS, max(round(scene.size[1] * CELLS / scene.size[0]), 2))
        self._foreground = np.stack([self._smaller(scene.foreground[k]) for k in scene.few])

    def score(self, view: View) -> float:
        """Correlation of silhouettes and foreground over space and time, -1..1, without loose parts."""
        weight = self._weight(view)
        wanted, drawn = _changes(self._foreground, weight), _changes(self._draw(view), weight)
        return float((wanted * drawn).sum() / np.sqrt(max((wanted**2).sum() * (drawn**2).sum(), 1e-12)))

    def fit(self, view: View, free: tuple[str, ...]) -> View:
        """Refine a view by Levenberg-Marquardt; free: intrinsics to fit besides the pose."""
        columns = [PARAMETERS.index(name) for name in (*POSE, *free)]
        damping = DAMPING[0]
        for _ in range(ROUNDS):
            weight = self._weight(view)
            wanted = _changes(self._foreground, weight)
            drawn = _changes(self._draw(view), weight)
            left, residual, gain = _residual(wanted, drawn)
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
                trial = view.updated(whole)
                now = _residual(wanted, _changes(self._draw(trial), weight))[0]
                if now < left:
                    view = trial
                    break
                damping *= 5.0
            if left - now < ENOUGH:
                break
            damping = max(damping / 5.0, DAMPING[1])
        return view

    def _slope(self, view: View, k: int, step: float, weight: np.ndarray) -> np.ndarray:
        """Derivative of the silhouettes by one parameter, as a central difference, flattened."""
        change = np.zeros(len(PARAMETERS))
        change[k] = step
        return 0.5 * _changes(self._draw(view.updated(change)) - self._draw(view.updated(-change)), weight).ravel()

    def _draw(self, view: View) -> np.ndarray:
        """Share of each cell that the robot covers (k, h, w), smoothed."""
        return np.stack([self._smaller((code > 0).astype(np.float32)) for code in self._codes(view)[0]])

    def _codes(self, view: View) -> tuple[np.ndarray, np.ndarray, float]:
        """Parts drawn on the finer grid (k, H, W), the vertices projected to its cells, and its focal length."""
        grid = view.of_size((self._grid[0] * FINER, self._grid[1] * FINER))
        seen = grid.project(self._vertices)
        return draw_parts(seen, self._body.faces, self._body.part, grid.size)[0], seen, grid.fx

    def _weight(self, view: View) -> np.ndarray:
        """Share of each cell that is not near a loose part (k, h, w)."""
        if not self._levels.loose.any():
            return np.ones_like(self._foreground)
        codes, seen, focal = self._codes(view)
        blind = [near_loose(c, s, self._levels, self._body, focal) for c, s in zip(codes, seen, strict=True)]
        return 1.0 - np.stack(
            [cv2.resize(b.astype(np.float32), self._grid, interpolation=cv2.INTER_AREA) for b in blind]
        )

    def _smaller(self, picture: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(cv2.resize(picture, self._grid, interpolation=cv2.INTER_AREA), (0, 0), SOFT)

    def _steps(self, view: View) -> np.ndarray:
        """Step of each parameter (11,) that moves the picture by about half a cell."""
        depth = view.project(self._vertices[:, ::10])[..., 2]
        away = max(float(np.median(depth)), 0.15)
        cell = 0.6 * self._size[0] / CELLS
        across, around = cell / view.fx, cell / (0.25 * self._size[0])
        lens = [cell / (0.2 * self._size[0])] * 2 + [cell / self._size[0]] * 2 + [0.05]
        return np.array([across, across, around, across * away, across * away, 3.0 * across * away, *lens])


def _changes(pictures: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Pictures (k, h, w) minus their mean over time, weighted."""
    mean = (pictures * weight).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-3)
    return (pictures - mean) * np.sqrt(weight)


def _residual(wanted: np.ndarray, drawn: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Residual energy as a share of the foreground's, the residual, and the best gain of the silhouettes."""
    gain = float((wanted * drawn).sum() / max((drawn**2).sum(), 1e-6))
    residual = wanted - gain * drawn
    return float((residual**2).sum() / max((wanted**2).sum(), 1e-9)), residual, gain
