"""Least squares over views that share a lens: outlines of the robot, marks, and what is known beforehand.

Gauss-Newton with Cauchy's weights; outlines are matched anew in every round, over a reach that shrinks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from embodiedreamer_gym.vis_aligner.camera_calibration.body import Figure
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Scene
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.outline import Outline, find_steps, predict
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

Report = Callable[[str, int, float], None]


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
    """Places of one scene's outline with the distance (N,) to the robot's edge, pixels, and its strength (N,)."""

    stand: int
    scene: Scene
    outline: Outline
    distance: np.ndarray
    strength: np.ndarray
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


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
        rows = scene.few if few else np.arange(len(scene.rows))
        found.append(Match(stand, scene, outline, *find_steps(outline, evidence, reach), rows))
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
        columns = np.r_[np.arange(len(free)), len(free) + stand * len(POSE) + np.arange(len(POSE))]
        matrix[np.ix_(columns, columns)] += (slopes * weight[:, None]).T @ slopes
        each = slopes * (weight * residual)[:, None]
        for one in np.unique(frame):
            vote = np.zeros(size)
            vote[columns] = each[frame == one].sum(axis=0)
            votes.append(vote)

    for m in matches:
        add(m.stand, *_outline_rows(m, state.views[m.stand], free, scale))
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


def _outline_rows(m: Match, view: View, free: Sequence[str], scale: float):
    """Slopes (N, p), residual (N,), weight (N,) and frame (N,) of one scene's outline, along the normals."""
    good = m.strength > CLEAR
    point, normal = m.outline.point[good], m.outline.normal[good]
    target = m.outline.pixel[good] + normal * m.distance[good, None]
    residual = ((target - view.see(point)[:, :2]) * normal).sum(axis=1)
    slopes = (view.slopes(point) * normal[:, :, None]).sum(axis=1)
    columns = [slopes[:, PARAMETERS.index(name)] if name != "delay" else _lag(m, good, view, slopes) for name in free]
    table = np.column_stack([*columns, slopes[:, : len(POSE)]])
    weight = m.strength[good] / (1.0 + (residual / scale) ** 2) / ALIKE
    return table, residual, weight, m.outline.frame[good]


def _lag(m: Match, good: np.ndarray, view: View, slopes: np.ndarray) -> np.ndarray:
    """Change (N,) along the normal by one row of delay."""
    drift = m.scene.drift[m.rows[m.outline.frame[good]], m.outline.part[good]]
    point = m.outline.point[good]
    speed = np.einsum("nij,nj->ni", drift[:, :3, :3], point) + drift[:, :3, 3]
    return -np.einsum("ni,ni->n", slopes[:, 3:6], speed @ view.turn.T)


def _mark_rows(marks: Keypoints, view: View, free: Sequence[str]):
    """The same of one stand's marks, every mark a frame of its own; a delay does not move them."""
    slopes = view.slopes(marks.point)
    residual = marks.pixel - view.see(marks.point)[:, :2]
    far = np.linalg.norm(residual, axis=1) / marks.sd
    weight = 1.0 / marks.sd**2 / (1.0 + (far / LATE) ** 2)
    zero = np.zeros_like(residual)
    columns = [slopes[:, :, PARAMETERS.index(name)] if name != "delay" else zero for name in free]
    table = (
        np.concatenate([np.stack(columns, axis=2), slopes[:, :, : len(POSE)]], axis=2) if columns else slopes[:, :, :6]
    )
    frame = np.repeat(np.arange(len(marks)), 2)
    return table.reshape(2 * len(marks), -1), residual.ravel(), np.repeat(weight, 2), frame


def _departure(name: str, state: State, anchor: State) -> float:
    """How far a shared parameter has gone from the anchor, in the units of a change."""
    now, then = state.views[0], anchor.views[0]
    width = now.size[0]
    return {
        "focal": float(np.log(now.fx / then.fx)), "aspect": float(np.log(now.aspect / then.aspect)),
        "cx": (now.cx - then.cx) / width, "cy": (now.cy - then.cy) / width, "k1": now.k1 - then.k1,
        "delay": state.delay - anchor.delay,
    }[name]  # fmt: skip


def with_lens(view: View, lens: View) -> View:
    """Return a view with the lens of another."""
    return replace(view, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, k1=lens.k1)
