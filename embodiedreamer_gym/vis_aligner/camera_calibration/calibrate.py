"""Lens and pose of a camera from what it saw of a robot, with a first guess or without."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.articulated_mesh import Body, Figure
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration.bundle_adjustment import (
    JUDGED,
    REACH,
    SHARED,
    State,
    follow,
    match,
    support,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.fit_quality import judge
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Footage, Scene, extent, look
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints, first_views
from embodiedreamer_gym.vis_aligner.camera_calibration.result import LEAST, CameraFit, names_of
from embodiedreamer_gym.vis_aligner.camera_calibration.search import Matcher, Report, search
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette import Silhouette
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

USUAL = 0.7  # focal length in widths of the picture, 71 degrees across, where nothing is known
LENS = ("focal", "aspect")  # what is fitted of the lens unless the user says otherwise
TRIED = 8  # views of a search that are fitted to silhouettes
FOLLOWED = 3  # of these, that are fitted to outlines
ASKED = 2  # other stands' views from which a stand is tried again
DETOUR = 1.5  # multiple of its support by which a view by way of silhouettes must beat one of outlines alone
BETTER = 1.1  # multiple of its support by which a view near another stand's must beat a stand's own
FAR_BETTER = 2.5  # the same for a view found by a new search: cameras are rather pushed than carried elsewhere
POOR = 0.6  # of the best stand's score: one that scores less is searched anew
ROUNDS = (16, 8)  # of all stands together: over all frames looked at, and over the few


def calibrate_camera(
    body: Body, footage: Sequence[Footage], *, start: Camera | None = None, marks: Keypoints | None = None,
    fixed: bool = False, free: Iterable[str] = LENS, loose: Iterable[str] = (), margin: float = 0.06,
    name: str = "camera", seed: int = 0, report: Report | None = None,
) -> CameraFit:  # fmt: skip
    """Find the lens and the poses of one camera from recordings of a robot before it.

    start: a first guess; without one, views from all around are tried. marks: of N points, their stand the number of
    the footage (0 where fixed). fixed: the camera stood in one place all the time; otherwise it may have been moved
    between two recordings. free: what of the lens is fitted, of focal, aspect, cx, cy, k1 and delay. loose: links that
    look otherwise in the pictures; margin: m around them in which no outline is believed. report: is told stage,
    step and value. The same seed gives the same result.
    Raises: VisionError where the footage shows no moving robot, it is not recognised, or arguments do not fit together.
    """
    chosen = _checked_free(free)
    if not footage:
        raise VisionError("there is no footage; give at least one recording with frames of the camera.")
    size = footage[0].size
    middle, radius = extent(body, np.concatenate([one.poses for one in footage]))
    figure = Figure.of(body, radius, loose, margin)
    scenes = [look(one, body, size) for one in footage]
    stands = [scenes] if fixed else [[scene] for scene in scenes]
    if marks is not None:
        if len(marks) and marks.stand.max() >= len(stands):
            raise VisionError(f"a mark is of stand {marks.stand.max()}, but stands are 0 .. {len(stands) - 1}.")
        marks = marks.scaled(size, scenes[0].size)
    task = _Task(figure, stands, middle, radius, chosen, marks, np.random.default_rng(seed), report)
    state = task.solve(None if start is None else View.of_camera(start, scenes[0].size))
    names = names_of(["all"] if fixed else [one.name for one in footage], name)
    fit = judge(figure, stands, state, task.anchor, chosen, marks, names, size)
    if start is None and marks is None and len(fit.doubtful) == len(fit.stands):
        score = max(one.score or 0.0 for one in fit.stands)
        raise VisionError(
            f"the robot is not recognised in the pictures (score {score:.2f}, at least {LEAST} is needed); check that the "
            "joint angles belong to these frames, or give a first guess, marks or masks."
        )
    return fit


def fit_keypoints(
    marks: Keypoints, size: tuple[int, int], *, start: Camera | None = None, free: Iterable[str] = ("focal",),
    name: str = "camera", names: Sequence[str] | None = None,
) -> CameraFit:  # fmt: skip
    """Find the lens and the poses of one camera from marks alone, at least four per stand; size: width and height.

    names: of the stands. Raises: VisionError where marks are too few, or no camera sees them so.
    """
    chosen = _checked_free(free)
    if "delay" in chosen:
        raise VisionError("marks alone do not show a delay; leave it out of what is fitted.")
    stands = int(marks.stand.max()) + 1 if len(marks) else 0
    if not stands or (names is not None and len(names) != stands):
        raise VisionError(f"marks are of {stands} stands; give at least four marks of each, and one name each.")
    views = first_views(marks, stands, size) if start is None else [View.of_camera(start, size)] * stands
    none = Body(np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros(3), ("nothing",))
    figure = Figure(none, none, none, np.zeros(1, bool), 0.0)
    anchor = State((views[0],))  # a usual lens would pull at the one that the marks show
    scenes: list[list[Scene]] = [[] for _ in range(stands)]
    state = follow(figure, scenes, State(tuple(views)), chosen, anchor, marks, rounds=40)
    called = names_of(list(names) if names is not None else [str(k) for k in range(stands)], name)
    return judge(figure, scenes, state, anchor, chosen, marks, called, size)


class _Task:
    """One calibration: from scenes of every stand to a state."""

    def __init__(
        self, figure: Figure, stands: list[list[Scene]], middle: np.ndarray, radius: float, free: tuple[str, ...],
        marks: Keypoints | None, rng: np.random.Generator, report: Report | None,
    ) -> None:  # fmt: skip
        self._figure, self._stands, self._middle, self._radius = figure, stands, middle, radius
        self._free, self._marks, self._rng, self._report = free, marks, rng, report
        self._shapes = [Silhouette(max(own, key=_lively), figure) for own in stands]
        size = stands[0][0].size
        self.anchor = State((View.looking(np.zeros(3), np.eye(3), USUAL * size[0], size),))

    def solve(self, start: View | None) -> State:
        """Return the best state; start: a first guess of every stand."""
        if start is not None:
            self.anchor = State((start,))
            return self._finish([start] * len(self._stands), REACH[0])
        if self._marks is not None and self._enough_marks():
            views = first_views(self._marks, len(self._stands), self._stands[0][0].size)
            self.anchor = State((views[0],))
            return self._finish(views, 0.5 * REACH[0])
        lead = int(np.argmax([max(map(_lively, own)) for own in self._stands]))
        first = self._alone(lead, self._searched(lead, None))
        views = [first if k == lead else self._near(k, first) for k in range(len(self._stands))]
        if len(views) > 1:
            views = self._second_thoughts(list(self._finish(views, 0.5 * REACH[0], few=True).views))
        return self._finish(views, 0.5 * REACH[0])

    def _finish(self, views: Sequence[View], reach: float, few: bool = False) -> State:
        """Follow the outlines of all stands at once, with one lens."""
        one = views[0]
        lens = {"fx": one.fx, "fy": one.fy, "cx": one.cx, "cy": one.cy, "k1": one.k1}
        state = State(tuple(replace(view, **lens) for view in views))
        return follow(self._figure, self._stands, state, self._free, self.anchor, self._marks, reach, few, ROUNDS[few],
                      report=self._report)  # fmt: skip

    def _second_thoughts(self, views: list[View]) -> list[View]:
        """Try every stand from the views of others, and from a new search where it still fits badly."""
        better = []
        for k, own in enumerate(views):
            others = sorted((v for j, v in enumerate(views) if j != k), key=lambda v: -self._shapes[k].score(v))
            promising = [v for v in others[:ASKED] if self._support(k, v) > self._support(k, own)]
            better.append(self._instead(k, own, promising, BETTER))
        scores = [shape.score(view) for shape, view in zip(self._shapes, better, strict=True)]
        for k, score in enumerate(scores):
            if score < POOR * max(scores):
                better[k] = self._instead(k, better[k], self._searched(k, better[k])[:FOLLOWED], FAR_BETTER)
        return better

    def _searched(self, k: int, lens: View | None) -> list[View]:
        """Views of a stand from all around, fitted to silhouettes, best first; lens: where it is known."""
        scene = max(self._stands[k], key=_lively)
        body, shape = self._figure.coarse, self._shapes[k]
        known = {} if lens is None else {"focal": lens.fx, "aspect": lens.aspect}
        matcher = Matcher(scene, body, scene.placed(body, few=True))
        found = search(matcher, scene.size, self._middle, self._radius, self._rng, report=self._report, **known)
        fitted = []
        for count, view in enumerate(found[:TRIED]):
            fitted.append(shape.fit(view, ("focal",) if lens is None else ()))
            if self._report is not None:
                self._report("silhouettes", count, shape.score(fitted[-1]))
        return sorted(fitted, key=lambda view: -shape.score(view))

    def _alone(self, k: int, views: Sequence[View]) -> View:
        """The best supported of some views of a stand after its outlines were followed, with a lens of its own."""
        lens = tuple(name for name in self._free if name != "delay")
        tried = [self._followed(k, view, lens, hold=False) for view in views[:FOLLOWED]]
        return max(tried, key=lambda view: self._support(k, view))

    def _near(self, k: int, view: View) -> View:
        """The view of a stand near to another stand's, the lens unchanged."""
        direct, around = (self._followed(k, one, ()) for one in (view, self._shapes[k].fit(view, ())))
        return around if self._support(k, around) > DETOUR * self._support(k, direct) else direct

    def _instead(self, k: int, own: View, views: Sequence[View], needed: float) -> View:
        """A stand's own view, or one followed from others with more than the needed multiple of its support."""
        tried = [own, *(self._followed(k, view, ()) for view in views)]
        best = max(tried, key=lambda view: self._support(k, view))
        return best if self._support(k, best) > needed * self._support(k, own) else own

    def _followed(self, k: int, view: View, free: tuple[str, ...], hold: bool = True) -> View:
        own, state = [self._stands[k]], State((view,))
        return follow(self._figure, own, state, free, self.anchor, few=True, hold=hold, report=self._report).views[0]

    def _support(self, k: int, view: View) -> float:
        return support(match(self._figure, self._stands[k], 0, State((view,)), JUDGED, few=True))

    def _enough_marks(self) -> bool:
        marks = self._marks
        return marks is not None and all((marks.stand == k).sum() >= 4 for k in range(len(self._stands)))


def _lively(scene: Scene) -> float:
    """How much of the picture the robot moves through."""
    return float(scene.evidence.var(axis=0).mean())


def _checked_free(free: Iterable[str]) -> tuple[str, ...]:
    chosen = tuple(dict.fromkeys(free))
    for name in chosen:
        if name not in SHARED:
            raise VisionError(f"'{name}' cannot be fitted; of the lens there are {', '.join(SHARED)}.")
    return chosen
