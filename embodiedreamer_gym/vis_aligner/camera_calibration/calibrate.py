"""Calibrate a camera from frames of a moving robot, with an initial guess or without."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.articulated_mesh import Body, DetailLevels
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.vis_aligner.camera_calibration.bundle_adjustment import (
    REACH,
    SHARED,
    SUPPORT_RANGE,
    State,
    bundle_adjust,
    edge_support,
    match,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.fit_quality import evaluate_fit
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Footage, Observations, bounding_sphere, observe
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints, initial_views
from embodiedreamer_gym.vis_aligner.camera_calibration.result import MIN_SCORE, CameraFit, names_of
from embodiedreamer_gym.vis_aligner.camera_calibration.search import Matcher, search
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette import Silhouette
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

DEFAULT_FOCAL = 0.7  # mean of the prior on the focal length, in widths of the picture (71 degrees across)
LENS = ("focal", "aspect")  # intrinsics fitted by default
TRIED = 8  # candidates of a search that are fitted to silhouettes
ADJUSTED = 3  # of these, candidates that are fitted to edges
NEIGHBOURS = 2  # views of other stations from which a station is fitted again
MIN_GAIN_OF_SILHOUETTE = 1.5  # factor of support by which a fit to silhouettes first must beat one to edges alone
MIN_GAIN = 1.1  # factor of support by which a fit from another station's view must beat the present one
MIN_GAIN_OF_SEARCH = 2.5  # the same for a new search: a camera is more likely pushed than moved far away
LOW_SCORE = 0.6  # of the best station's score: a station below it is searched again
ROUNDS = (16, 8)  # of the joint adjustment: over all selected frames, and over those of the search


def calibrate_camera(
    body: Body, footage: Sequence[Footage], *, start: Camera | None = None, marks: Keypoints | None = None,
    fixed: bool = False, free: Iterable[str] = LENS, loose: Iterable[str] = (), margin: float = 0.06,
    name: str = "camera", seed: int = 0, report: ProgressCallback | None = None,
) -> CameraFit:  # fmt: skip
    """Estimate intrinsics and poses of one camera from recordings of a robot in its view; the same for the same seed.

    body: meshes of the robot's links.
    footage: recordings; the camera does not move within one.
    start: initial guess; without one, views from all around the robot are searched.
    marks: marked points; their station is the number of the footage (0 if fixed).
    fixed: whether the camera was in one place throughout; otherwise it may have moved between recordings.
    free: parameters to fit, of focal, aspect, cx, cy, k1 and delay.
    loose: links whose shape differs in the pictures; margin: distance around them within which edges are ignored, m.
    name: of the camera.
    seed: of the search.
    report: called as progress(stage, done, total, **quantities).
    Raises: VisionError where no moving robot is visible, it is not recognised, or arguments are inconsistent.
    """
    chosen, report = _checked_free(free), progress_or_silence(report)
    if not footage:
        raise VisionError("there is no footage; give at least one recording with frames of the camera.")
    size = footage[0].size
    middle, radius = bounding_sphere(body, np.concatenate([one.poses for one in footage]))
    levels = DetailLevels.of(body, radius, loose, margin)
    scenes = [observe(one, body, size) for one in footage]
    stations = [scenes] if fixed else [[scene] for scene in scenes]
    if marks is not None:
        if len(marks) and marks.station.max() >= len(stations):
            raise VisionError(
                f"a mark belongs to station {marks.station.max()}, but stations are 0 .. {len(stations) - 1}."
            )
        marks = marks.scaled(size, scenes[0].size)
    task = _Calibration(levels, stations, middle, radius, chosen, marks, np.random.default_rng(seed), report)
    state = task.solve(None if start is None else View.from_camera(start, scenes[0].size))
    names = names_of(["all"] if fixed else [one.name for one in footage], name)
    fit = evaluate_fit(levels, stations, state, task.prior, chosen, marks, names, size)
    if start is None and marks is None and len(fit.doubtful) == len(fit.stations):
        score = max(one.score or 0.0 for one in fit.stations)
        raise VisionError(
            f"the robot is not recognised in the pictures (score {score:.2f}, at least {MIN_SCORE} is needed); check that the "
            "joint angles belong to these frames, or give a first guess, marks or masks."
        )
    return fit


def fit_keypoints(
    marks: Keypoints, size: tuple[int, int], *, start: Camera | None = None, free: Iterable[str] = ("focal",),
    name: str = "camera", names: Sequence[str] | None = None,
) -> CameraFit:  # fmt: skip
    """Estimate intrinsics and poses of one camera from marked points alone, at least four per station.

    size: width and height of the frames.
    names: of the stations.
    Raises: VisionError where marks are too few, or no camera is consistent with them.
    """
    chosen = _checked_free(free)
    if "delay" in chosen:
        raise VisionError("marks alone do not show a delay; leave it out of what is fitted.")
    stations = int(marks.station.max()) + 1 if len(marks) else 0
    if not stations or (names is not None and len(names) != stations):
        raise VisionError(
            f"the marks belong to {stations} stations; give at least four marks of each, and one name each."
        )
    views = initial_views(marks, stations, size) if start is None else [View.from_camera(start, size)] * stations
    none = Body(np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros(3), ("nothing",))
    levels = DetailLevels(none, none, none, np.zeros(1, bool), 0.0)
    prior = State((views[0],))  # the default focal length would bias the fit
    scenes: list[list[Observations]] = [[] for _ in range(stations)]
    state = bundle_adjust(levels, scenes, State(tuple(views)), chosen, prior, marks, rounds=40)
    station_names = names_of(list(names) if names is not None else [str(k) for k in range(stations)], name)
    return evaluate_fit(levels, scenes, state, prior, chosen, marks, station_names, size)


class _Calibration:
    """One calibration: from the observations of every station to adjusted views."""

    def __init__(
        self, levels: DetailLevels, stations: list[list[Observations]], middle: np.ndarray, radius: float, free: tuple[str, ...],
        marks: Keypoints | None, rng: np.random.Generator, report: ProgressCallback | None,
    ) -> None:  # fmt: skip
        self._levels, self._stations, self._middle, self._radius = levels, stations, middle, radius
        self._free, self._marks, self._rng, self._report = free, marks, rng, report
        self._shapes = [Silhouette(max(own, key=_foreground_variance), levels) for own in stations]
        size = stations[0][0].size
        self.prior = State((View.from_pose(np.zeros(3), np.eye(3), DEFAULT_FOCAL * size[0], size),))

    def solve(self, start: View | None) -> State:
        """The best state; start: initial guess for every station."""
        if start is not None:
            self.prior = State((start,))
            return self._adjust_all([start] * len(self._stations), REACH[0])
        if self._marks is not None and self._enough_marks():
            views = initial_views(self._marks, len(self._stations), self._stations[0][0].size)
            self.prior = State((views[0],))
            return self._adjust_all(views, 0.5 * REACH[0])
        lead = int(np.argmax([max(map(_foreground_variance, own)) for own in self._stations]))
        first = self._fit_alone(lead, self._search(lead, None))
        views = [first if k == lead else self._fit_near(k, first) for k in range(len(self._stations))]
        if len(views) > 1:
            views = self._retry_stations(list(self._adjust_all(views, 0.5 * REACH[0], few=True).views))
        return self._adjust_all(views, 0.5 * REACH[0])

    def _adjust_all(self, views: Sequence[View], reach: float, few: bool = False) -> State:
        """Adjust all stations jointly, with shared intrinsics."""
        one = views[0]
        lens = {"fx": one.fx, "fy": one.fy, "cx": one.cx, "cy": one.cy, "k1": one.k1}
        state = State(tuple(replace(view, **lens) for view in views))
        return bundle_adjust(self._levels, self._stations, state, self._free, self.prior, self._marks, reach, few, ROUNDS[few],
                      report=self._report)  # fmt: skip

    def _retry_stations(self, views: list[View]) -> list[View]:
        """Fit every station again from views of others, and from a new search where its score is low."""
        better = []
        for k, own in enumerate(views):
            others = sorted((v for j, v in enumerate(views) if j != k), key=lambda v: -self._shapes[k].score(v))
            promising = [v for v in others[:NEIGHBOURS] if self._edge_support(k, v) > self._edge_support(k, own)]
            better.append(self._better_of(k, own, promising, MIN_GAIN))
        scores = [shape.score(view) for shape, view in zip(self._shapes, better, strict=True)]
        for k, score in enumerate(scores):
            if score < LOW_SCORE * max(scores):
                better[k] = self._better_of(k, better[k], self._search(k, better[k])[:ADJUSTED], MIN_GAIN_OF_SEARCH)
        return better

    def _search(self, k: int, lens: View | None) -> list[View]:
        """Candidate views of a station fitted to silhouettes, best first; lens: view with known intrinsics."""
        scene = max(self._stations[k], key=_foreground_variance)
        body, shape = self._levels.coarse, self._shapes[k]
        known = {} if lens is None else {"focal": lens.fx, "aspect": lens.aspect}
        matcher = Matcher(scene, body, scene.vertices(body, few=True))
        found = search(matcher, scene.size, self._middle, self._radius, self._rng, report=self._report, **known)
        fitted = []
        for count, view in enumerate(found[:TRIED]):
            fitted.append(shape.fit(view, ("focal",) if lens is None else ()))
            if self._report is not None:
                self._report("silhouettes", count, len(found[:TRIED]), overlap=f"{shape.score(fitted[-1]):.3g}")
        return sorted(fitted, key=lambda view: -shape.score(view))

    def _fit_alone(self, k: int, views: Sequence[View]) -> View:
        """The candidate with the most support after adjusting it, with intrinsics, to the edges of one station."""
        lens = tuple(name for name in self._free if name != "delay")
        tried = [self._adjusted(k, view, lens, hold=False) for view in views[:ADJUSTED]]
        return max(tried, key=lambda view: self._edge_support(k, view))

    def _fit_near(self, k: int, view: View) -> View:
        """A station's view fitted from another station's, with fixed intrinsics."""
        direct, around = (self._adjusted(k, one, ()) for one in (view, self._shapes[k].fit(view, ())))
        return (
            around if self._edge_support(k, around) > MIN_GAIN_OF_SILHOUETTE * self._edge_support(k, direct) else direct
        )

    def _better_of(self, k: int, own: View, views: Sequence[View], needed: float) -> View:
        """A station's own view, or one adjusted from others with more than `needed` times its support."""
        tried = [own, *(self._adjusted(k, view, ()) for view in views)]
        best = max(tried, key=lambda view: self._edge_support(k, view))
        return best if self._edge_support(k, best) > needed * self._edge_support(k, own) else own

    def _adjusted(self, k: int, view: View, free: tuple[str, ...], hold: bool = True) -> View:
        own, state = [self._stations[k]], State((view,))
        return bundle_adjust(
            self._levels, own, state, free, self.prior, few=True, hold=hold, report=self._report
        ).views[0]

    def _edge_support(self, k: int, view: View) -> float:
        return edge_support(match(self._levels, self._stations[k], 0, State((view,)), SUPPORT_RANGE, few=True))

    def _enough_marks(self) -> bool:
        marks = self._marks
        return marks is not None and all((marks.station == k).sum() >= 4 for k in range(len(self._stations)))


def _foreground_variance(scene: Observations) -> float:
    """Mean variance of the foreground over time: how much of the picture the robot moves through."""
    return float(scene.foreground.var(axis=0).mean())


def _checked_free(free: Iterable[str]) -> tuple[str, ...]:
    chosen = tuple(dict.fromkeys(free))
    for name in chosen:
        if name not in SHARED:
            raise VisionError(f"'{name}' cannot be fitted; the parameters are {', '.join(SHARED)}.")
    return chosen
