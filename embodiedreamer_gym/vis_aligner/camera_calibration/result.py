"""Result of a camera calibration, with its residuals and standard deviations."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

MIN_RELATIVE_SCORE = 0.5  # share of the largest score: a station below it is doubtful
MIN_SCORE = 0.3  # a station below it is doubtful: measured 0.42 .. 0.76 with a robot in view, 0.21 in noise


@dataclass(frozen=True)
class StationFit:
    """Result for one station (place of the camera); errors in pixels of the frames, None where not applicable.

    camera: calibrated pinhole camera.
    frames: number of frames used.
    outline: median distance of the predicted silhouette edge from the matched edge.
    found: share of the moving links' predicted edge that has a matched edge.
    score: correlation of silhouettes and foreground over space and time, -1..1.
    overlap: intersection over union of silhouettes and foreground.
    marks: median reprojection error of the fitted marks.
    position_sd, rotation_sd, picture_sd: standard deviations of position, m, rotation, rad, and projected points,
    pixels.
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
    """A calibrated camera: shared intrinsics, and a pose for each station.

    stations: result of each station.
    free: fitted parameters.
    k1: radial distortion as in OpenCV; a Camera has none, see `undistorted`.
    delay: rows by which pictures are later than joint angles.
    sd: standard deviation of each free parameter; focal, cx and cy in pixels.
    """

    stations: tuple[StationFit, ...]
    free: tuple[str, ...]
    k1: float = 0.0
    delay: float = 0.0
    sd: Mapping[str, float] = field(default_factory=dict)

    @property
    def stands(self) -> tuple[StationFit, ...]:
        """Former name of `stations`."""
        warnings.warn("CameraFit.stands is now CameraFit.stations", DeprecationWarning, stacklevel=2)
        return self.stations

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The camera of every station."""
        return tuple(one.camera for one in self.stations)

    @property
    def camera(self) -> Camera:
        """The camera of the only station.

        Raises: VisionError when there are several.
        """
        if len(self.stations) != 1:
            names = ", ".join(one.camera.name for one in self.stations)
            raise VisionError(f"the camera stood in {len(self.stations)} places ({names}); use one of fit.cameras.")
        return self.stations[0].camera

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Names of the stations with a low score, absolute or relative to the best one's."""
        scored = [(one.score, one.camera.name) for one in self.stations if one.score is not None]
        best = max((score for score, _ in scored), default=0.0)
        return tuple(name for score, name in scored if score < max(MIN_SCORE, MIN_RELATIVE_SCORE * best))

    def views(self) -> tuple[View, ...]:
        """Views of all stations, with distortion, for pictures of the camera's size."""
        return tuple(View.from_camera(camera, k1=self.k1) for camera in self.cameras)

    def undistorted(self, frame: np.ndarray) -> np.ndarray:
        """A frame (H, W, 3) without the radial distortion."""
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
        rows = [_row(one) for one in self.stations]
        head = ("camera", "frames", "position m", "± mm", "outline px", "found", "score", "overlap", "marks px", "± px")
        widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
        lines += [
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in (head, *rows)
        ]
        if self.doubtful:
            lines += ["", f"doubtful, look at the overlay: {', '.join(self.doubtful)}"]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON-compatible data (m, rad, pixels, quaternions xyzw); the stations' key is "stands"."""
        stations = [
            {
                "camera": {key: value for key, value in vars(one.camera).items() if not key.startswith("_")},
                **{key: value for key, value in vars(one).items() if key != "camera"},
            }
            for one in self.stations
        ]
        return {"stands": stations, "fitted": list(self.free), "k1": self.k1, "delay": self.delay, "sd": dict(self.sd),
                "doubtful": list(self.doubtful)}  # fmt: skip


def _row(one: StationFit) -> tuple[str, ...]:
    place = " ".join(f"{x:+.3f}" for x in one.camera.position)

    def cell(value: float | None, form: str, factor: float = 1.0) -> str:
        return "" if value is None else format(value * factor, form)

    return (one.camera.name, str(one.frames or ""), place, cell(one.position_sd, ".1f", 1e3), cell(one.outline, ".2f"),
            cell(one.found, ".0%"), cell(one.score, ".2f"), cell(one.overlap, ".2f"), cell(one.marks, ".2f"),
            cell(one.picture_sd, ".2f"))  # fmt: skip


def names_of(names: Sequence[str], prefix: str) -> tuple[str, ...]:
    """Names of cameras: the prefix alone for one station, else with the name of its recording."""
    return (prefix,) if len(names) == 1 else tuple(f"{prefix}/{name}" for name in names)
