"""Points of the robot that somebody marked in pictures, and the views that they alone give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.camera_calibration.search import FOCAL
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

FEWEST = 4  # marks of one stand that give a pose
FOCALS = 12  # lengths tried
CONSENT = 0.03  # of the picture's width: farther marks do not support a first pose
TRIALS = 300


@dataclass(frozen=True, eq=False)
class Keypoints:
    """N marks: a point of the robot, and where it is seen.

    stand (N,): from which place of the camera, counted from 0; point (N, 3): m, in the robot's root frame at the joint
    angles of that frame; pixel (N, 2): column and row, the middle of the first pixel is 0, 0; sd (N,): pixels, how
    sure the mark is. Raises: VisionError where these do not fit together.
    """

    stand: np.ndarray
    point: np.ndarray
    pixel: np.ndarray
    sd: np.ndarray

    def __post_init__(self) -> None:
        for field, kind in (("stand", int), ("point", float), ("pixel", float), ("sd", float)):
            object.__setattr__(self, field, np.asarray(getattr(self, field), kind))
        n = len(self.stand)
        if self.point.shape != (n, 3) or self.pixel.shape != (n, 2) or self.sd.shape != (n,):
            raise VisionError(
                f"{n} marks need points ({n}, 3), pixels ({n}, 2) and sd ({n},), "
                f"not {self.point.shape}, {self.pixel.shape} and {self.sd.shape}."
            )
        if not (np.isfinite(self.point).all() and np.isfinite(self.pixel).all() and (self.sd > 0.0).all()):
            raise VisionError("marks must be finite, and their standard deviations above 0 pixels.")
        if n and self.stand.min() < 0:
            raise VisionError("the stands of marks count from 0.")

    def __len__(self) -> int:
        return len(self.stand)

    def __repr__(self) -> str:
        return f"Keypoints({len(self)} marks, {len(np.unique(self.stand))} stands)"

    def of(self, which: np.ndarray) -> Keypoints:
        """Return some of the marks, by number or bool."""
        return Keypoints(self.stand[which], self.point[which], self.pixel[which], self.sd[which])

    def scaled(self, size: tuple[int, int], to: tuple[int, int]) -> Keypoints:
        """Return the marks for the same pictures in another size (width, height)."""
        factor = np.array(to) / np.array(size)
        return Keypoints(self.stand, self.point, (self.pixel + 0.5) * factor - 0.5, self.sd * factor[0])

    def errors(self, views: Sequence[View]) -> np.ndarray:
        """Distance (N,), pixels, of each mark from where its stand's view sees the point."""
        found = np.zeros(len(self))
        for k, view in enumerate(views):
            own = self.stand == k
            found[own] = np.linalg.norm(view.see(self.point[own])[:, :2] - self.pixel[own], axis=1)
        return found


def first_views(marks: Keypoints, stands: int, size: tuple[int, int], aspect: float = 1.0) -> list[View]:
    """A view of every stand from its marks alone, with the focal length that suits all of them best.

    Raises: VisionError for a stand with fewer than four marks, or marks that no camera sees so.
    """
    for k in range(stands):
        count = int((marks.stand == k).sum())
        if count < FEWEST:
            raise VisionError(
                f"stand {k} of the camera has {count} marks; without a start at least {FEWEST} are needed."
            )
    best: tuple[float, list[View]] | None = None
    for focal in size[0] * np.geomspace(*FOCAL, FOCALS):
        views = [_pose(marks.of(marks.stand == k), float(focal), size, aspect) for k in range(stands)]
        seen = [view for view in views if view is not None]
        if len(seen) < stands:
            continue
        error = float(np.minimum(marks.errors(seen) / marks.sd, CONSENT * size[0] / marks.sd).sum())
        if best is None or error < best[0]:
            best = error, seen
    if best is None:
        raise VisionError("no camera sees the marks like this; check that points and pixels belong together.")
    return best[1]


def _pose(marks: Keypoints, focal: float, size: tuple[int, int], aspect: float) -> View | None:
    """The view of one stand at a focal length."""
    lens = View.looking(np.zeros(3), np.eye(3), focal, size, aspect)
    matrix = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)
    try:
        good, turn, shift, _ = cv2.solvePnPRansac(
            marks.point, marks.pixel, matrix, None, reprojectionError=CONSENT * size[0], iterationsCount=TRIALS,
            flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
    except cv2.error:  # points on a line, or all alike
        return None
    if not good:
        return None
    rotation = cv2.Rodrigues(turn)[0]
    view = View(rotation, shift.ravel(), lens.fx, lens.fy, lens.cx, lens.cy, size)
    return view if (view.see(marks.point)[:, 2] > 0.0).mean() > 0.5 else None
