"""Initial views without a guess: cameras sampled around the robot, ranked by correlation with the foreground.

Silhouettes and foreground are compared over space and time, each minus its mean over time, so that static pixels have
no effect; the correlation covers all shifts of the picture at once (by FFT).
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy import fft
from scipy.stats import qmc

from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

CELLS = 40  # of the coarse grid across the picture
TRIED = 2048  # sampled views, a power of two
FAR = (0.35, 3.0)  # distances of the camera, in radii of the sphere in which the robot moves
FOCAL = (0.3, 1.3)  # focal lengths, in widths of the picture: 118 to 42 degrees across
LOW, STEEP = -0.3, 0.9  # sine of the elevation: its minimum, and the value above which the camera's roll is free
ASIDE = 0.35  # radii by which the optical axis may miss the centre of the sphere
THIN = 0.02  # floor of a shift's energy in the normalisation, as a share of the largest


class Matcher:
    """Compares silhouettes with the foreground of a scene on a coarse grid, over all shifts.

    vertices (k, V, 3): vertices of the body in the scene's few rows.
    """

    def __init__(self, scene: Observations, body: Body, vertices: np.ndarray) -> None:
        self._body, self._vertices, self._size = body, vertices, scene.size
        self._scale = CELLS / scene.size[0]
        self._window = (CELLS, max(round(scene.size[1] * self._scale), 2))
        self._canvas = (2 * self._window[0], 2 * self._window[1])
        small = [cv2.resize(scene.foreground[k], self._window, interpolation=cv2.INTER_AREA) for k in scene.few]
        pattern = np.stack(small)
        pattern -= pattern.mean(axis=0)
        self._energy = float((pattern**2).sum())
        self._shape = tuple(
            fft.next_fast_len(c + w, real=True) for c, w in zip(self._canvas[::-1], self._window[::-1], strict=True)
        )
        self._pattern = self._spectrum(pattern).conj()
        self._box = self._spectrum(np.ones(self._window[::-1], np.float32)).conj()

    def match(self, view: View) -> tuple[float, View]:
        """The correlation at the best shift of the picture, and the view rotated by that shift."""
        wide, high = self._canvas
        scale = self._scale
        grid = View(
            view.rotation,
            view.translation,
            view.fx * scale,
            view.fy * scale,
            0.5 * (wide - 1),
            0.5 * (high - 1),
            self._canvas,
        )
        code, _ = draw_parts(grid.project(self._vertices), self._body.faces, self._body.part, self._canvas)
        drawn = (code > 0).astype(np.float32)
        drawn -= drawn.mean(axis=0)
        fits = self._correlate(self._spectrum(drawn) * self._pattern)
        energy = self._correlate((self._spectrum((drawn**2).sum(axis=0)) * self._box)[None])
        score = fits / np.sqrt(np.maximum(energy, THIN * energy.max() + 1e-3) * self._energy)
        row, column = divmod(int(score.argmax()), score.shape[1])
        shift = np.array([column, row]) - 0.5 * (np.array(self._canvas) - self._window)
        return float(score[row, column]), _rotated(view, shift / scale)

    def _spectrum(self, pictures: np.ndarray) -> np.ndarray:
        return np.asarray(fft.rfft2(pictures, self._shape))

    def _correlate(self, product: np.ndarray) -> np.ndarray:
        rows, columns = (c - w + 1 for c, w in zip(self._canvas[::-1], self._window[::-1], strict=True))
        return np.asarray(fft.irfft2(product.sum(axis=0), self._shape))[:rows, :columns]


def search(
    matcher: Matcher, size: tuple[int, int], middle: np.ndarray, radius: float, rng: np.random.Generator,
    focal: float | None = None, aspect: float = 1.0, report: ProgressCallback | None = None,
) -> list[View]:  # fmt: skip
    """Sampled views, best match first.

    size: width and height of the pictures.
    middle, radius: sphere in which the robot moves, m.
    focal: pixels, where known.
    """
    draws = qmc.Sobol(8, rng=rng).random(TRIED)
    scored: list[tuple[float, View]] = []
    for count, draw in enumerate(draws):
        length = size[0] * FOCAL[0] * (FOCAL[1] / FOCAL[0]) ** draw[0] if focal is None else focal
        scored.append(matcher.match(_sample_view(draw[1:], middle, radius, length, aspect, size)))
        if report is not None and count % 64 == 0:
            report("search", count, len(draws), best_overlap=f"{max(score for score, _ in scored):.3g}")
    return [view for _, view in sorted(scored, key=lambda one: -one[0])]


def _sample_view(draw, middle, radius, focal, aspect, size) -> View:
    """The view of one sample (7,), each 0..1."""
    sine = LOW + (1.0 - LOW) * draw[0]
    azimuth = 2.0 * np.pi * draw[1]
    level = np.sqrt(max(1.0 - sine * sine, 0.0))
    way = np.array([level * np.cos(azimuth), level * np.sin(azimuth), sine])
    target = middle + ASIDE * radius * (2.0 * draw[3:6] - 1.0)
    position = target + radius * FAR[0] * (FAR[1] / FAR[0]) ** draw[2] * way
    up = np.array([0.0, 0.0, 1.0])
    if sine > STEEP:
        up = np.array([np.cos(2.0 * np.pi * draw[6]), np.sin(2.0 * np.pi * draw[6]), 0.0])
    right = np.cross(-way, up)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    return View.from_pose(position, np.stack([right, np.cross(-way, right), -way]), focal, size, aspect)


def _rotated(view: View, shift: np.ndarray) -> View:
    """The view rotated so that a point at an offset (2,), pixels, from the optical axis moves onto the axis."""
    ahead = np.array([shift[0] / view.fx, shift[1] / view.fy, 1.0])
    ahead /= np.linalg.norm(ahead)
    axis = np.cross([0.0, 0.0, 1.0], ahead)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return view
    change = np.zeros(11)
    change[:3] = -axis / sine * np.arcsin(min(sine, 1.0))
    return view.updated(change)
