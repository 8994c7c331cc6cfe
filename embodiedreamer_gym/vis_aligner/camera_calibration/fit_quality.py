"""How well a state fits: distances of outlines and marks, overlap, standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.geometry.articulated_mesh import Figure
from embodiedreamer_gym.geometry.rasterizer import draw_parts
from embodiedreamer_gym.vis_aligner.camera_calibration.bundle_adjustment import (
    CLEAR,
    JUDGED,
    Match,
    Normal,
    State,
    build,
    columns,
    covariance,
    match,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Scene
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.result import CameraFit, StandFit
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette import Silhouette
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette_edges import near_loose
from embodiedreamer_gym.vis_aligner.camera_calibration.view import POSE, View

SCALE = 1.0  # pixels beyond which a step counts less
HALF = 0.5  # evidence above which a pixel is taken for the robot


def judge(
    figure: Figure, stands: Sequence[Sequence[Scene]], state: State, anchor: State, free: tuple[str, ...],
    marks: Keypoints | None, names: Sequence[str], size: tuple[int, int],
) -> CameraFit:  # fmt: skip
    """Sum up what was found; size: width and height of the frames, to which everything is scaled back."""
    matches = [match(figure, own, k, state, JUDGED) for k, own in enumerate(stands)]
    normal = build([m for own in matches for m in own], state, free, marks, anchor, SCALE)
    spread = covariance(normal)
    factor = size[0] / state.views[0].size[0]
    found = []
    for k, (own, view) in enumerate(zip(stands, state.views, strict=True)):
        places = _places(matches[k], marks, k)
        lens = list(range(len(free)))
        pose = [len(free) + k * len(POSE) + j for j in range(len(POSE))]
        seen = _picture_sd(view, places, free, spread[np.ix_(lens + pose, lens + pose)])
        marked = _marks_error(marks, k, view)
        outline, share = _outline_quality(matches[k], factor)
        score, overlap = _area_quality(figure, own, view)
        rotation_sd, position_sd = (float(np.sqrt(np.diag(spread)[part].sum())) for part in (pose[:3], pose[3:]))
        found.append(
            StandFit(
                view.of_size(size).camera(names[k]), sum(len(scene.rows) for scene in own), outline, share, score, overlap,
                None if marked is None else marked * factor, position_sd, rotation_sd,
                None if seen is None else seen * factor,
            )
        )  # fmt: skip
    return CameraFit(tuple(found), free, state.views[0].k1, state.delay, _shared_sd(normal, spread, state, free, size))


def _places(matches: Sequence[Match], marks: Keypoints | None, k: int) -> np.ndarray:
    """Points (N, 3), m, that this stand's fit rests on."""
    parts = [m.outline.point for m in matches]
    if marks is not None:
        parts.append(marks.point[marks.stand == k])
    return np.concatenate([np.zeros((0, 3)), *parts])


def _picture_sd(view: View, places: np.ndarray, free: tuple[str, ...], spread: np.ndarray) -> float | None:
    """Median standard deviation, pixels, of where points are seen."""
    if not len(places):
        return None
    table = columns(view.slopes(places[:: max(len(places) // 200, 1)]), free)
    variance = np.einsum("nip,pq,niq->n", table, spread, table)
    return float(np.median(np.sqrt(np.maximum(variance, 0.0))))


def _marks_error(marks: Keypoints | None, k: int, view: View) -> float | None:
    if marks is None or not (marks.stand == k).any():
        return None
    own = marks.of(marks.stand == k)
    return float(np.median(np.linalg.norm(view.see(own.point)[:, :2] - own.pixel, axis=1)))


def _outline_quality(matches: Sequence[Match], factor: float) -> tuple[float | None, float | None]:
    """Median distance in pixels of the frames, and share of the outline that found an edge."""
    strength = np.concatenate([np.zeros(0), *(m.strength for m in matches)])
    if not len(strength):
        return None, None
    good = strength > CLEAR
    distance = np.abs(np.concatenate([m.distance for m in matches]))[good]
    return (float(np.median(distance)) * factor if len(distance) else None), float(good.mean())


def _area_quality(figure: Figure, scenes: Sequence[Scene], view: View) -> tuple[float | None, float | None]:
    """Correlation of silhouettes and evidence, and intersection over union, loose parts left out; medians of scenes."""
    scores = [Silhouette(scene, figure).score(view) for scene in scenes]
    shares = []
    for scene in scenes:
        seen = view.see(scene.placed(figure.fine))
        both = either = 0
        for t, code in enumerate(draw_parts(seen, figure.fine.faces, figure.fine.part, scene.size)[0]):
            kept = ~near_loose(code, seen[t], figure, figure.fine, view.fx)
            drawn, wanted = (code > 0) & kept, (scene.evidence[t] > HALF) & kept
            both, either = both + int((drawn & wanted).sum()), either + int((drawn | wanted).sum())
        shares.append(both / max(either, 1))
    return (float(np.median(scores)), float(np.median(shares))) if scenes else (None, None)


def _shared_sd(
    normal: Normal, spread: np.ndarray, state: State, free: tuple[str, ...], size: tuple[int, int]
) -> dict[str, float]:
    """Standard deviations of the free parameters, in pixels of the frames where they are of the picture."""
    view = state.views[0]
    unit = {"focal": view.fx * size[0] / view.size[0], "aspect": view.aspect, "cx": size[0], "cy": size[0]}
    return {name: float(np.sqrt(spread[j, j])) * unit.get(name, 1.0) for j, name in enumerate(free)}
