"""Least squares over views that share a lens: outlines of the robot, marks, and what is known beforehand.

Gauss-Newton with Cauchy's weights; outlines are matched anew in every round, over a reach that shrinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import Figure
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Scene
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.search import Report
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import Outline, find_steps, predict
from embodiedreamer_gym.vis_aligner.camera_calibration.view import LENS, PARAMETERS, POSE, View

SHARED = (*LENS, "delay")  # what all stands have in common, besides the time by which pictures are late
PRIOR = {"focal": 0.5, "aspect": 0.05, "cx": 0.03, "cy": 0.03, "k1": 0.1, "delay": 1.0}  # sd, in the units of a change
CLEAR = 0.2  # strength of a step that counts
ALIKE = 20.0  # places of outlines that say together as much as one: neighbours err alike
SHRINK = 0.85  # of the reach, from round to round
REACH = (0.045, 0.0125)  # of the picture's width: the first, and the last
HELD = 2.0  # multiples of the last reach beyond which the lens is held
SURE = 1.5  # pixels within which a step supports a view
JUDGED = 5.0  # pixels to either side over which support is looked for
LATE = 3.0  # standard deviations beyond which a mark counts less
INNER = 3
RIDGE = 1e-3
SETTLED = 2e-4  # largest change of a parameter (rad, m and the like) in a round that is the last


@dataclass(frozen=True, eq=False)
class State:
    """One view per stand, all with one lens, and the rows by which pictures are late."""

    views: tuple[View, ...]
    delay: float = 0.0

    def moved(self, change: np.ndarray, free: Sequence[str]) -> State:
        """Return the state after a change: the free shared parameters, then six of each stand's pose."""
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
            views.append(view.moved(own))
        return State(tuple(views), self.delay + late)


@dataclass(frozen=True, eq=False)
class Match:
    """Places of one scene's outline with the distance (N,) to the robot's edge, pixels, and its strength (N,).

    delay: rows, at which the places were predicted; speed (N, 3): m per row, of the places.
    """

    stand: int
    outline: Outline
    distance: np.ndarray
    strength: np.ndarray
    delay: float
    speed: np.ndarray

    def points(self, delay: float) -> np.ndarray:
        """Where the places (N, 3), m, are at another delay."""
        return self.outline.point - (delay - self.delay) * self.speed


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal matrix (p, p) and right side (p,) of a least squares, and the latter frame by frame (G, p)."""

    matrix: np.ndarray
    side: np.ndarray
    by_frame: np.ndarray


def match(
    figure: Figure, scenes: Sequence[Scene], stand: int, state: State, reach: float, few: bool = False
) -> list[Match]:
    """Match the outlines of scenes of one stand over a reach, pixels."""
    found = []
    for scene in scenes:
        outline = predict(figure, scene.placed(figure.fine, few, state.delay), state.views[stand])
        outline = outline.of(scene.moving[outline.part])
        evidence = scene.evidence[scene.few] if few else scene.evidence
        drift = (scene.drift[scene.few] if few else scene.drift)[outline.frame, outline.part]
        speed = np.einsum("nij,nj->ni", drift[:, :3, :3], outline.point) + drift[:, :3, 3]
        found.append(Match(stand, outline, *find_steps(outline, evidence, reach), state.delay, speed))
    return found


def support(matches: Sequence[Match]) -> float:
    """How much of the outlines lies on edges: sum of strength, less where further off."""
    return float(sum((m.strength * np.exp(-0.5 * (m.distance / SURE) ** 2)).sum() for m in matches))


def follow(
    figure: Figure, stands: Sequence[Sequence[Scene]], state: State, free: Sequence[str], anchor: State,
    marks: Keypoints | None = None, reach: float = REACH[0], few: bool = False, rounds: int = 16, hold: bool = True,
    report: Report | None = None,
) -> State:  # fmt: skip
    """Move views until their outlines lie on the edges of the robot in the pictures, and marks on their points.

    anchor: what is known of the lens beforehand; reach: of the first round, in widths of the picture; few: only the
    scenes' few frames; hold: the lens changes only once the reach is short, as far matches are often wrong ones.
    """
    width = state.views[0].size[0]
    for count in range(rounds):
        wide = max(reach * SHRINK**count, REACH[1]) * width
        matches = [m for k, own in enumerate(stands) for m in match(figure, own, k, state, wide, few)]
        moved, now = 0.0, () if hold and wide > HELD * REACH[1] * width else free
        for _ in range(INNER):
            change = solve(build(matches, state, now, marks, anchor, max(1.0, wide / 4.0)))
            state = state.moved(change, now)
            moved = max(moved, float(np.abs(change).max()))
            if np.abs(change).max() < SETTLED:
                break
        if report is not None:
            report("outlines", count, moved)
        if wide <= REACH[1] * width and moved < SETTLED:
            break
    return state


def solve(normal: Normal) -> np.ndarray:
    """Return the change (p,) that least squares asks for, slightly damped."""
    ridge = RIDGE * np.diag(normal.matrix) + 1e-9 * max(float(np.trace(normal.matrix)), 1e-9)
    return np.linalg.solve(normal.matrix + np.diag(ridge), normal.side)


def covariance(normal: Normal) -> np.ndarray:
    """Covariance (p, p) of the parameters, from the spread of the frames' votes (a sandwich)."""
    ridge = np.diag(1e-9 * np.maximum(np.diag(normal.matrix), 1e-9))
    bread = np.linalg.inv(normal.matrix + ridge)
    frames = len(normal.by_frame)
    return bread @ (normal.by_frame.T @ normal.by_frame) @ bread * frames / max(frames - 1, 1)


def build(matches: Sequence[Match], state: State, free: Sequence[str], marks: Keypoints | None, anchor: State,
          scale: float) -> Normal:  # fmt: skip
    """Put outlines, marks and what is known beforehand together; scale: pixels beyond which a step counts less."""
    size = len(free) + len(POSE) * len(state.views)
    matrix, votes = np.zeros((size, size)), []

    def add(stand: int, slopes: np.ndarray, residual: np.ndarray, weight: np.ndarray, frame: np.ndarray) -> None:
        place = np.r_[np.arange(len(free)), len(free) + stand * len(POSE) + np.arange(len(POSE))]
        matrix[np.ix_(place, place)] += (slopes * weight[:, None]).T @ slopes
        each = slopes * (weight * residual)[:, None]
        for one in np.unique(frame):
            vote = np.zeros(size)
            vote[place] = each[frame == one].sum(axis=0)
            votes.append(vote)

    for m in matches:
        add(m.stand, *_outline_rows(m, state.views[m.stand], state.delay, free, scale))
    if marks is not None:
        for k, view in enumerate(state.views):
            own = marks.of(marks.stand == k)
            if len(own):
                add(k, *_mark_rows(own, view, free))
    by_frame = np.array(votes) if votes else np.zeros((0, size))
    side = by_frame.sum(axis=0)
    for j, name in enumerate(free):
        weight = PRIOR[name] ** -2
        matrix[j, j] += weight
        side[j] -= weight * _departure(name, state, anchor)
    return Normal(matrix, side, by_frame)


def _outline_rows(m: Match, view: View, delay: float, free: Sequence[str], scale: float):
    """Slopes (N, p), residual (N,), weight (N,) and frame (N,) of one scene's outline, along the normals."""
    good = m.strength > CLEAR
    point, normal = m.points(delay)[good], m.outline.normal[good]
    target = m.outline.pixel[good] + normal * m.distance[good, None]
    residual = ((target - view.see(point)[:, :2]) * normal).sum(axis=1)
    lag = -m.speed[good] @ view.turn.T
    slopes = (columns(view.slopes(point), free, lag) * normal[:, :, None]).sum(axis=1)
    weight = m.strength[good] / (1.0 + (residual / scale) ** 2) / ALIKE
    return slopes, residual, weight, m.outline.frame[good]


def columns(slopes: np.ndarray, free: Sequence[str], lag: np.ndarray | None = None) -> np.ndarray:
    """Slopes (N, 2, p) by the free shared parameters and a pose, of those (N, 2, 11) by all of a view's parameters.

    lag (N, 3): m, change of the points in the camera's frame by one row of delay; None: they stay.
    """
    late = np.zeros(slopes.shape[:2]) if lag is None else np.einsum("nij,nj->ni", slopes[:, :, 3:6], lag)
    shared = [late if name == "delay" else slopes[:, :, PARAMETERS.index(name)] for name in free]
    return np.stack([*shared, *np.moveaxis(slopes[:, :, : len(POSE)], 2, 0)], axis=2)


def _mark_rows(marks: Keypoints, view: View, free: Sequence[str]):
    """The same of one stand's marks, every mark a frame of its own; a delay does not move them."""
    slopes = columns(view.slopes(marks.point), free)
    residual = marks.pixel - view.see(marks.point)[:, :2]
    far = np.linalg.norm(residual, axis=1) / marks.sd
    weight = 1.0 / marks.sd**2 / (1.0 + (far / LATE) ** 2)
    frame = np.repeat(np.arange(len(marks)), 2)
    return slopes.reshape(2 * len(marks), -1), residual.ravel(), np.repeat(weight, 2), frame


def _departure(name: str, state: State, anchor: State) -> float:
    """How far a shared parameter has gone from the anchor, in the units of a change."""
    now, then = state.views[0], anchor.views[0]
    width = now.size[0]
    return {
        "focal": float(np.log(now.fx / then.fx)), "aspect": float(np.log(now.aspect / then.aspect)),
        "cx": (now.cx - then.cx) / width, "cy": (now.cy - then.cy) / width, "k1": now.k1 - then.k1,
        "delay": state.delay - anchor.delay,
    }[name]  # fmt: skip
