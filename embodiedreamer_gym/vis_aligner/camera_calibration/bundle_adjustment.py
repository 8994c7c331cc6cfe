"""Bundle adjustment: camera poses and shared intrinsics from the robot's silhouette edges, marked points and a prior.

Gauss-Newton with Cauchy weights. Edges are matched again in every round, within a range that shrinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import Outline, find_steps, predict
from embodiedreamer_gym.vis_aligner.camera_calibration.view import LENS, PARAMETERS, POSE, View

SHARED = (*LENS, "delay")  # parameters common to all stations; delay: rows by which pictures are late
# standard deviations of the prior, in units of a View's change
PRIOR_SD = {"focal": 0.5, "aspect": 0.05, "cx": 0.03, "cy": 0.03, "k1": 0.1, "delay": 1.0}
MIN_STRENGTH = 0.2  # strength of an edge that is used
CORRELATED = 20.0  # edge points that count as one observation, as errors of neighbours are correlated
SHRINK = 0.85  # factor of the search range from round to round
REACH = (0.045, 0.0125)  # first and last search range, in widths of the picture
LENS_HELD = 2.0  # multiples of the last search range above which the intrinsics are held fixed
SUPPORT_SD = 1.5  # pixels, residual scale of the support of a view
SUPPORT_RANGE = 5.0  # pixels to either side within which support is measured
OUTLIER = 3.0  # standard deviations above which a mark is down-weighted
INNER_STEPS = 3  # Gauss-Newton steps per round
RIDGE = 1e-3  # damping of a step, relative to the diagonal
CONVERGED = 2e-4  # largest change of a parameter (rad, m, ...) in the last round


@dataclass(frozen=True, eq=False)
class State:
    """Parameters of an adjustment: one view per station, with shared intrinsics, and the pictures' delay in rows."""

    views: tuple[View, ...]
    delay: float = 0.0

    def updated(self, change: np.ndarray, free: Sequence[str]) -> State:
        """Return the state after a change: the free shared parameters, then six of each station's pose."""
        lens = np.zeros(len(PARAMETERS))
        late = 0.0
        for value, name in zip(change, free, strict=False):
            if name == "delay":
                late = float(value)
            else:
                lens[PARAMETERS.index(name)] = value
        views = []
        for k, view in enumerate(self.views):
            own = lens.copy()
            own[: len(POSE)] = change[len(free) + k * len(POSE) :][: len(POSE)]
            views.append(view.updated(own))
        return State(tuple(views), self.delay + late)


@dataclass(frozen=True, eq=False)
class Match:
    """Predicted edge points of one recording, matched to edges in its pictures.

    station: number of the camera's place.
    outline: the predicted points.
    distance: to the matched edge along the normal (N,), pixels.
    strength: of that edge (N,), 0..1.
    delay: rows, for which the points were predicted.
    speed: of the points (N, 3), m per row.
    """

    station: int
    outline: Outline
    distance: np.ndarray
    strength: np.ndarray
    delay: float
    speed: np.ndarray

    def points(self, delay: float) -> np.ndarray:
        """The points (N, 3), m, at another delay."""
        return self.outline.point - (delay - self.delay) * self.speed


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal matrix (p, p), right-hand side (p,), and its contribution by frame (G, p)."""

    matrix: np.ndarray
    side: np.ndarray
    by_frame: np.ndarray


def match(
    levels: DetailLevels, scenes: Sequence[Observations], station: int, state: State, reach: float, few: bool = False
) -> list[Match]:
    """Match predicted edges of one station's recordings within a search range, pixels; few: in the search's frames."""
    matches = []
    for scene in scenes:
        outline = predict(levels, scene.vertices(levels.fine, few, state.delay), state.views[station])
        outline = outline.of(scene.moving[outline.part])
        foreground = scene.foreground[scene.few] if few else scene.foreground
        velocity = (scene.velocity[scene.few] if few else scene.velocity)[outline.frame, outline.part]
        speed = np.einsum("nij,nj->ni", velocity[:, :3, :3], outline.point) + velocity[:, :3, 3]
        matches.append(Match(station, outline, *find_steps(outline, foreground, reach), state.delay, speed))
    return matches


def edge_support(matches: Sequence[Match]) -> float:
    """Sum of the strengths of matched edges, weighted by a Gaussian of their distance."""
    return float(sum((m.strength * np.exp(-0.5 * (m.distance / SUPPORT_SD) ** 2)).sum() for m in matches))


def bundle_adjust(
    levels: DetailLevels, stations: Sequence[Sequence[Observations]], state: State, free: Sequence[str], prior: State,
    marks: Keypoints | None = None, reach: float = REACH[0], few: bool = False, rounds: int = 16, hold: bool = True,
    report: ProgressCallback | None = None,
) -> State:  # fmt: skip
    """Adjust views until predicted edges coincide with those in the pictures, and marked points with their marks.

    stations: recordings of each station.
    free: shared parameters to fit, of SHARED.
    prior: mean of the prior on the intrinsics and delay.
    reach: first search range, in widths of the picture.
    few: use only the frames of the search.
    hold: fit intrinsics only once the search range is short, as distant matches are often wrong.
    """
    width = state.views[0].size[0]
    for count in range(rounds):
        wide = max(reach * SHRINK**count, REACH[1]) * width
        matches = [m for k, own in enumerate(stations) for m in match(levels, own, k, state, wide, few)]
        moved, now = 0.0, () if hold and wide > LENS_HELD * REACH[1] * width else free
        for _ in range(INNER_STEPS):
            change = solve(build(matches, state, now, marks, prior, max(1.0, wide / 4.0)))
            state = state.updated(change, now)
            moved = max(moved, float(np.abs(change).max()))
            if np.abs(change).max() < CONVERGED:
                break
        if report is not None:
            report("outlines", count, largest_step=f"{moved:.3g}")
        if wide <= REACH[1] * width and moved < CONVERGED:
            break
    return state


def solve(normal: NormalEquations) -> np.ndarray:
    """The damped least-squares step (p,)."""
    ridge = RIDGE * np.diag(normal.matrix) + 1e-9 * max(float(np.trace(normal.matrix)), 1e-9)
    return np.linalg.solve(normal.matrix + np.diag(ridge), normal.side)


def covariance(normal: NormalEquations) -> np.ndarray:
    """Covariance (p, p) of the parameters: sandwich estimator clustered by frame."""
    ridge = np.diag(1e-9 * np.maximum(np.diag(normal.matrix), 1e-9))
    bread = np.linalg.inv(normal.matrix + ridge)
    frames = len(normal.by_frame)
    return bread @ (normal.by_frame.T @ normal.by_frame) @ bread * frames / max(frames - 1, 1)


def build(matches: Sequence[Match], state: State, free: Sequence[str], marks: Keypoints | None, prior: State,
          scale: float) -> NormalEquations:  # fmt: skip
    """Normal equations of edges, marks and prior; scale: of the Cauchy weights, pixels."""
    size = len(free) + len(POSE) * len(state.views)
    matrix, gradients = np.zeros((size, size)), []

    def add(station: int, slopes: np.ndarray, residual: np.ndarray, weight: np.ndarray, frame: np.ndarray) -> None:
        place = np.r_[np.arange(len(free)), len(free) + station * len(POSE) + np.arange(len(POSE))]
        matrix[np.ix_(place, place)] += (slopes * weight[:, None]).T @ slopes
        each = slopes * (weight * residual)[:, None]
        for one in np.unique(frame):
            gradient = np.zeros(size)
            gradient[place] = each[frame == one].sum(axis=0)
            gradients.append(gradient)

    for m in matches:
        add(m.station, *_outline_rows(m, state.views[m.station], state.delay, free, scale))
    if marks is not None:
        for k, view in enumerate(state.views):
            own = marks.of(marks.station == k)
            if len(own):
                add(k, *_mark_rows(own, view, free))
    by_frame = np.array(gradients) if gradients else np.zeros((0, size))
    side = by_frame.sum(axis=0)
    for j, name in enumerate(free):
        weight = PRIOR_SD[name] ** -2
        matrix[j, j] += weight
        side[j] -= weight * _deviation(name, state, prior)
    return NormalEquations(matrix, side, by_frame)


def _outline_rows(m: Match, view: View, delay: float, free: Sequence[str], scale: float):
    """Jacobian (N, p), residual (N,), weight (N,) and frame (N,) of matched edges along their normals."""
    good = m.strength > MIN_STRENGTH
    point, normal = m.points(delay)[good], m.outline.normal[good]
    target = m.outline.pixel[good] + normal * m.distance[good, None]
    residual = ((target - view.project(point)[:, :2]) * normal).sum(axis=1)
    lag = -m.speed[good] @ view.rotation.T
    slopes = (jacobian_columns(view.jacobian(point), free, lag) * normal[:, :, None]).sum(axis=1)
    weight = m.strength[good] / (1.0 + (residual / scale) ** 2) / CORRELATED
    return slopes, residual, weight, m.outline.frame[good]


def jacobian_columns(slopes: np.ndarray, free: Sequence[str], lag: np.ndarray | None = None) -> np.ndarray:
    """Jacobian (N, 2, p) by the free shared parameters and the pose, from that by all of a view's parameters (N, 2, 11).

    lag: change of the points in the camera's frame by one row of delay (N, 3), m; None: no change.
    """
    late = np.zeros(slopes.shape[:2]) if lag is None else np.einsum("nij,nj->ni", slopes[:, :, 3:6], lag)
    shared = [late if name == "delay" else slopes[:, :, PARAMETERS.index(name)] for name in free]
    return np.stack([*shared, *np.moveaxis(slopes[:, :, : len(POSE)], 2, 0)], axis=2)


def _mark_rows(marks: Keypoints, view: View, free: Sequence[str]):
    """The same for one station's marks; each mark counts as its own frame, and the delay has no effect."""
    slopes = jacobian_columns(view.jacobian(marks.point), free)
    residual = marks.pixel - view.project(marks.point)[:, :2]
    far = np.linalg.norm(residual, axis=1) / marks.sd
    weight = 1.0 / marks.sd**2 / (1.0 + (far / OUTLIER) ** 2)
    frame = np.repeat(np.arange(len(marks)), 2)
    return slopes.reshape(2 * len(marks), -1), residual.ravel(), np.repeat(weight, 2), frame


def _deviation(name: str, state: State, prior: State) -> float:
    """Difference of a shared parameter from the prior's mean, in units of a View's change."""
    now, then = state.views[0], prior.views[0]
    width = now.size[0]
    return {
        "focal": float(np.log(now.fx / then.fx)), "aspect": float(np.log(now.aspect / then.aspect)),
        "cx": (now.cx - then.cx) / width, "cy": (now.cy - then.cy) / width, "k1": now.k1 - then.k1,
        "delay": state.delay - prior.delay,
    }[name]  # fmt: skip
