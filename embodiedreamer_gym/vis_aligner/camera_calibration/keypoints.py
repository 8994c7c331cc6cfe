"""Marked points of the robot in pictures (2D-3D correspondences), and initial views from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.vis_aligner.camera_calibration.search import FOCAL
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

MIN_MARKS = 4  # of one station, for a pose
FOCALS = 12  # focal lengths tried
INLIER = 0.03  # of the picture's width: RANSAC's largest reprojection error of an inlier
TRIALS = 300  # RANSAC's iterations


@renamed_arguments(stand="station")
@dataclass(frozen=True, eq=False)
class Keypoints:
    """N marks: correspondences between points of the robot and pixels.

    station: number of the camera's place (N,), from 0.
    point: in the robot's root frame at the joint angles of that frame (N, 3), m.
    pixel: column and row (N, 2); the centre of the first pixel is 0, 0.
    sd: standard deviation of the mark (N,), pixels.
    Raises: VisionError where shapes differ or values are not finite.
    """

    station: np.ndarray
    point: np.ndarray
    pixel: np.ndarray
    sd: np.ndarray

    def __post_init__(self) -> None:
        for field, kind in (("station", int), ("point", float), ("pixel", float), ("sd", float)):
            object.__setattr__(self, field, np.asarray(getattr(self, field), kind))
        n = len(self.station)
        if self.point.shape != (n, 3) or self.pixel.shape != (n, 2) or self.sd.shape != (n,):
            raise VisionError(
                f"{n} marks need points ({n}, 3), pixels ({n}, 2) and sd ({n},), "
                f"not {self.point.shape}, {self.pixel.shape} and {self.sd.shape}."
            )
        if not (np.isfinite(self.point).all() and np.isfinite(self.pixel).all() and (self.sd > 0.0).all()):
            raise VisionError("marks must be finite, and their standard deviations above 0 pixels.")
        if n and self.station.min() < 0:
            raise VisionError("the stations of marks count from 0.")

    def __len__(self) -> int:
        return len(self.station)

    def __repr__(self) -> str:
        return f"Keypoints({len(self)} marks, {len(np.unique(self.station))} stations)"

    def of(self, which: np.ndarray) -> Keypoints:
        """A subset of the marks, by number or bool."""
        return Keypoints(self.station[which], self.point[which], self.pixel[which], self.sd[which])

    def scaled(self, size: tuple[int, int], to: tuple[int, int]) -> Keypoints:
        """The marks in the same pictures at another size (width, height)."""
        factor = np.array(to) / np.array(size)
        return Keypoints(self.station, self.point, (self.pixel + 0.5) * factor - 0.5, self.sd * factor[0])

    def errors(self, views: Sequence[View]) -> np.ndarray:
        """Reprojection error (N,) of each mark in its station's view, pixels."""
        errors = np.zeros(len(self))
        for k, view in enumerate(views):
            own = self.station == k
            errors[own] = np.linalg.norm(view.project(self.point[own])[:, :2] - self.pixel[own], axis=1)
        return errors


def initial_views(marks: Keypoints, stations: int, size: tuple[int, int], aspect: float = 1.0) -> list[View]:
    """A view of every station by PnP, with the focal length that has the smallest total reprojection error.

    Raises: VisionError for a station with fewer than four marks, or marks consistent with no camera.
    """
    for k in range(stations):
        count = int((marks.station == k).sum())
        if count < MIN_MARKS:
            raise VisionError(
                f"station {k} of the camera has {count} marks; without a start at least {MIN_MARKS} are needed."
            )
    best: tuple[float, list[View]] | None = None
    for focal in size[0] * np.geomspace(*FOCAL, FOCALS):
        views = [_pose(marks.of(marks.station == k), float(focal), size, aspect) for k in range(stations)]
        seen = [view for view in views if view is not None]
        if len(seen) < stations:
            continue
        error = float(np.minimum(marks.errors(seen) / marks.sd, INLIER * size[0] / marks.sd).sum())
        if best is None or error < best[0]:
            best = error, seen
    if best is None:
        raise VisionError("no camera sees the marks like this; check that points and pixels belong together.")
    return best[1]


def _pose(marks: Keypoints, focal: float, size: tuple[int, int], aspect: float) -> View | None:
    """The view of one station at a focal length, by PnP with RANSAC; None if it fails."""
    lens = View.from_pose(np.zeros(3), np.eye(3), focal, size, aspect)
    matrix = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)
    try:
        good, rotation_vector, translation, _ = cv2.solvePnPRansac(
            marks.point, marks.pixel, matrix, None, reprojectionError=INLIER * size[0], iterationsCount=TRIALS,
            flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
    except cv2.error:  # points on a line, or all equal
        return None
    if not good:
        return None
    rotation = cv2.Rodrigues(rotation_vector)[0]
    view = View(rotation, translation.ravel(), lens.fx, lens.fy, lens.cx, lens.cy, size)
    return view if (view.project(marks.point)[:, 2] > 0.0).mean() > 0.5 else None
