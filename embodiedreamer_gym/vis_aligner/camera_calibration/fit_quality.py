"""Quality of a calibration: residuals of edges and marks, overlap of silhouettes, standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.bundle_adjustment import (
    MIN_STRENGTH,
    SUPPORT_RANGE,
    Match,
    NormalEquations,
    State,
    build,
    covariance,
    jacobian_columns,
    match,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.result import CameraFit, StationFit
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette import Silhouette
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import near_loose
from embodiedreamer_gym.vis_aligner.camera_calibration.view import POSE, View

SCALE = 1.0  # pixels, of the Cauchy weights
HALF = 0.5  # foreground above which a pixel counts as the robot


def evaluate_fit(
    levels: DetailLevels, stations: Sequence[Sequence[Observations]], state: State, prior: State, free: tuple[str, ...],
    marks: Keypoints | None, names: Sequence[str], size: tuple[int, int],
) -> CameraFit:  # fmt: skip
    """Residuals, overlap and standard deviations of every station; size: width and height of the frames, for the units."""
    matches = [match(levels, own, k, state, SUPPORT_RANGE) for k, own in enumerate(stations)]
    normal = build([m for own in matches for m in own], state, free, marks, prior, SCALE)
    spread = covariance(normal)
    factor = size[0] / state.views[0].size[0]
    fits = []
    for k, (own, view) in enumerate(zip(stations, state.views, strict=True)):
        places = _places(matches[k], marks, k)
        lens = list(range(len(free)))
        pose = [len(free) + k * len(POSE) + j for j in range(len(POSE))]
        seen = _picture_sd(view, places, free, spread[np.ix_(lens + pose, lens + pose)])
        marked = _marks_error(marks, k, view)
        outline, share = _outline_quality(matches[k], factor)
        score, overlap = _area_quality(levels, own, view)
        rotation_sd, position_sd = (float(np.sqrt(np.diag(spread)[part].sum())) for part in (pose[:3], pose[3:]))
        fits.append(
            StationFit(
                view.of_size(size).camera(names[k]), sum(len(scene.rows) for scene in own), outline, share, score, overlap,
                None if marked is None else marked * factor, position_sd, rotation_sd,
                None if seen is None else seen * factor,
            )
        )  # fmt: skip
    return CameraFit(tuple(fits), free, state.views[0].k1, state.delay, _shared_sd(normal, spread, state, free, size))


def _places(matches: Sequence[Match], marks: Keypoints | None, k: int) -> np.ndarray:
    """Points (N, 3) used in this station's fit, m."""
    parts = [m.outline.point for m in matches]
    if marks is not None:
        parts.append(marks.point[marks.station == k])
    return np.concatenate([np.zeros((0, 3)), *parts])


def _picture_sd(view: View, places: np.ndarray, free: tuple[str, ...], spread: np.ndarray) -> float | None:
    """Median standard deviation of projected points, pixels."""
    if not len(places):
        return None
    table = jacobian_columns(view.jacobian(places[:: max(len(places) // 200, 1)]), free)
    variance = np.einsum("nip,pq,niq->n", table, spread, table)
    return float(np.median(np.sqrt(np.maximum(variance, 0.0))))


def _marks_error(marks: Keypoints | None, k: int, view: View) -> float | None:
    if marks is None or not (marks.station == k).any():
        return None
    own = marks.of(marks.station == k)
    return float(np.median(np.linalg.norm(view.project(own.point)[:, :2] - own.pixel, axis=1)))


def _outline_quality(matches: Sequence[Match], factor: float) -> tuple[float | None, float | None]:
    """Median edge residual in pixels of the frames, and share of the outline with a matched edge."""
    strength = np.concatenate([np.zeros(0), *(m.strength for m in matches)])
    if not len(strength):
        return None, None
    good = strength > MIN_STRENGTH
    distance = np.abs(np.concatenate([m.distance for m in matches]))[good]
    return (float(np.median(distance)) * factor if len(distance) else None), float(good.mean())


def _area_quality(
    levels: DetailLevels, scenes: Sequence[Observations], view: View
) -> tuple[float | None, float | None]:
    """Correlation and intersection over union of silhouettes and foreground, without loose parts; medians of recordings."""
    scores = [Silhouette(scene, levels).score(view) for scene in scenes]
    shares = []
    for scene in scenes:
        seen = view.project(scene.vertices(levels.fine))
        both = either = 0
        for t, code in enumerate(draw_parts(seen, levels.fine.faces, levels.fine.part, scene.size)[0]):
            kept = ~near_loose(code, seen[t], levels, levels.fine, view.fx)
            drawn, wanted = (code > 0) & kept, (scene.foreground[t] > HALF) & kept
            both, either = both + int((drawn & wanted).sum()), either + int((drawn | wanted).sum())
        shares.append(both / max(either, 1))
    return (float(np.median(scores)), float(np.median(shares))) if scenes else (None, None)


def _shared_sd(
    normal: NormalEquations, spread: np.ndarray, state: State, free: tuple[str, ...], size: tuple[int, int]
) -> dict[str, float]:
    """Standard deviations of the free parameters; focal, cx and cy in pixels of the frames."""
    view = state.views[0]
    unit = {"focal": view.fx * size[0] / view.size[0], "aspect": view.aspect, "cx": size[0], "cy": size[0]}
    return {name: float(np.sqrt(spread[j, j])) * unit.get(name, 1.0) for j, name in enumerate(free)}
