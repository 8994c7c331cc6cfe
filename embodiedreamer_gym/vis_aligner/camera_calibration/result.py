"""What a calibration found, and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

WEAK = 0.5  # of the largest score: a stand that scores less is doubtful
LEAST = 0.3  # score below which it is too: 0.42 .. 0.76 where a robot was recognised, 0.21 in noise without one


@dataclass(frozen=True)
class StandFit:
    """What was found of one place of the camera; errors in pixels of the frames.

    outline: median distance of the robot's predicted outline from its edge in the pictures, where one is found; found:
    share of the moving links' outline where it is; score: correlation, -1 .. 1, of silhouettes and evidence over space and time;
    overlap: intersection over union of the two; marks, unused: median error of marks that were fitted, and of others;
    position_sd m, rotation_sd rad, picture_sd pixels: standard deviations. None where there is no such thing.
    """

    camera: Camera
    frames: int = 0
    outline: float | None = None
    found: float | None = None
    score: float | None = None
    overlap: float | None = None
    marks: float | None = None
    position_sd: float | None = None
    rotation_sd: float | None = None
    picture_sd: float | None = None


@dataclass(frozen=True, eq=False)
class CameraFit:
    """Cameras of one lens, one for each place where it stood.

    stands: what was found of each; free: what was fitted of the lens; k1: radial distortion as in OpenCV, which a
    Camera does not have (see `undistorted`); delay: rows by which pictures are later than joint angles;
    sd: standard deviation of each free parameter, focal in pixels, cx and cy too.
    """

    stands: tuple[StandFit, ...]
    free: tuple[str, ...]
    k1: float = 0.0
    delay: float = 0.0
    sd: Mapping[str, float] = field(default_factory=dict)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The camera of every stand."""
        return tuple(one.camera for one in self.stands)

    @property
    def camera(self) -> Camera:
        """The camera, where it stood in one place.

        Raises: VisionError when it stood in several.
        """
        if len(self.stands) != 1:
            names = ", ".join(one.camera.name for one in self.stands)
            raise VisionError(f"the camera stood in {len(self.stands)} places ({names}); take one of fit.cameras.")
        return self.stands[0].camera

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Names of the stands whose silhouettes fit badly, or far worse than the best one's."""
        scored = [(one.score, one.camera.name) for one in self.stands if one.score is not None]
        best = max((score for score, _ in scored), default=0.0)
        return tuple(name for score, name in scored if score < max(LEAST, WEAK * best))

    def views(self) -> tuple[View, ...]:
        """Every camera with its distortion, for pictures of the camera's size."""
        return tuple(View.of_camera(camera, k1=self.k1) for camera in self.cameras)

    def undistorted(self, frame: np.ndarray) -> np.ndarray:
        """Return a frame (H, W, 3) as the pinhole camera would have taken it."""
        if self.k1 == 0.0:
            return frame
        matrix = self.cameras[0].matrix((frame.shape[1], frame.shape[0]))
        return cv2.undistort(frame, matrix, np.array([self.k1, 0.0, 0.0, 0.0]))

    def __str__(self) -> str:
        camera = self.cameras[0]
        lens = [f"fx {camera.fx:.1f}", f"fy {camera.fy:.1f}", f"cx {camera.cx:.1f}", f"cy {camera.cy:.1f}"]
        lens += [f"k1 {self.k1:.3f}"] if self.k1 else []
        lens += [f"delay {self.delay:.2f} rows"] if "delay" in self.free else []
        size = f"{camera.size[0]} x {camera.size[1]}"
        known = ", ".join(f"{name} ± {value:.2g}" for name, value in self.sd.items()) or "nothing"
        lines = [f"lens at {size}: {', '.join(lens)} px (fitted: {known})", ""]
        rows = [_row(one) for one in self.stands]
        head = ("camera", "frames", "position m", "± mm", "outline px", "found", "score", "overlap", "marks px", "± px")
        widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
        lines += [
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in (head, *rows)
        ]
        if self.doubtful:
            lines += ["", f"doubtful, look at the overlay: {', '.join(self.doubtful)}"]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Everything as JSON: m, rad, pixels, quaternions xyzw."""
        stands = [
            {
                "camera": {key: value for key, value in vars(one.camera).items() if not key.startswith("_")},
                **{key: value for key, value in vars(one).items() if key != "camera"},
            }
            for one in self.stands
        ]
        return {"stands": stands, "fitted": list(self.free), "k1": self.k1, "delay": self.delay, "sd": dict(self.sd),
                "doubtful": list(self.doubtful)}  # fmt: skip


def _row(one: StandFit) -> tuple[str, ...]:
    place = " ".join(f"{x:+.3f}" for x in one.camera.position)

    def said(value: float | None, form: str, factor: float = 1.0) -> str:
        return "" if value is None else format(value * factor, form)

    return (one.camera.name, str(one.frames or ""), place, said(one.position_sd, ".1f", 1e3), said(one.outline, ".2f"),
            said(one.found, ".0%"), said(one.score, ".2f"), said(one.overlap, ".2f"), said(one.marks, ".2f"),
            said(one.picture_sd, ".2f"))  # fmt: skip


def names_of(names: Sequence[str], prefix: str) -> tuple[str, ...]:
    """Names of cameras: the prefix alone for one stand, else with the name of what was recorded there."""
    return (prefix,) if len(names) == 1 else tuple(f"{prefix}/{name}" for name in names)
