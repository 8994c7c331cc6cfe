"""Recordings of a robot by a static camera, and the frames and foreground that a fit uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.recordings import FrameSource
from embodiedreamer_gym.vis_aligner.camera_calibration.motion_mask import foreground_of_motion, smooth
from embodiedreamer_gym.vis_aligner.farthest_points import spread

MIN_FRAMES = 6  # of one recording
MIN_EDGE, MAX_RATIO = 8, 10  # pixels of a picture's shorter edge, and of the longer one per pixel of the shorter
SELECTED = 24  # frames of a recording that are fitted
BACKGROUND = 40  # frames whose median is the background
WIDTHS = (240, 384)  # pixels: smaller pictures are enlarged for a fit, larger ones reduced
MARKERS = 64  # vertices by which motion is measured
FARTHEST = 1e4  # m, of a link from the robot's root
STILL = 0.005  # m: a point that moves less counts as static
FAINT = 1e-4  # variance of the foreground over time below which nothing moves


@dataclass(frozen=True, eq=False)
class Footage:
    """One recording of a robot by a camera that does not move during it.

    frames: T pictures (H, W, 3), uint8 RGB, an array or read one by one.
    poses: of the body's parts in the frame of the robot's root link (T, P, 4, 4), m.
    masks: T pictures (H, W), nonzero where the robot is; None: the robot is found by its motion.
    name: of the recording.
    Raises: VisionError where the lengths or shapes differ, or a pose is not finite.
    """

    frames: FrameSource | np.ndarray
    poses: np.ndarray
    masks: Sequence[np.ndarray] | np.ndarray | None = None
    name: str = "recording"

    def __post_init__(self) -> None:
        poses = np.asarray(self.poses, np.float64)
        object.__setattr__(self, "poses", poses)
        if poses.ndim != 4 or poses.shape[2:] != (4, 4):
            raise VisionError(f"{self.name}: poses must be (T, P, 4, 4), one 4x4 per row and link, not {poses.shape}.")
        good = (np.abs(poses) <= FARTHEST).all(axis=(1, 2, 3))
        if not good.all():
            row = int(np.argmin(good))
            raise VisionError(f"{self.name}: the joint angles of row {row} are not finite, or too large; leave it out.")
        for what, given in (("frames", self.frames), ("masks", self.masks)):
            if not hasattr(given, "__len__") and (what == "frames" or given is not None):
                raise VisionError(
                    f"{self.name}: {what} must be pictures, one per row of joint angles, not {given!r:.40}."
                )
            if given is not None and len(given) != len(poses):
                raise VisionError(
                    f"{self.name}: {len(given)} {what} for {len(poses)} rows of joint angles; give one each."
                )
        if len(poses) < MIN_FRAMES:
            raise VisionError(f"{self.name}: {len(poses)} frames are too few; at least {MIN_FRAMES} are needed.")

    def __repr__(self) -> str:
        return f"Footage({self.name!r}, {len(self.poses)} frames{', masks' if self.masks is not None else ''})"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures.

        Raises: VisionError when the first frame is not a picture, or is too small or too narrow for a fit.
        """
        height, width = self.frame(0).shape[:2]
        if min(height, width) < MIN_EDGE or max(height, width) > MAX_RATIO * min(height, width):
            raise VisionError(
                f"{self.name}: frames are {width} x {height}; both edges must have at least {MIN_EDGE} pixels, and the longer "
                f"one at most {MAX_RATIO} times the shorter one."
            )
        return width, height

    def frame(self, row: int) -> np.ndarray:
        """Return one picture (H, W, 3), uint8 RGB.

        Raises: VisionError when it is not such a picture.
        """
        picture = np.asarray(self.frames[int(row)])
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
            raise VisionError(f"{self.name}: frame {row} is {_describe(picture)}, not uint8 RGB (H, W, 3).")
        return picture


@dataclass(frozen=True, eq=False)
class Observations:
    """Data of one recording for a fit.

    name: of the recording.
    rows: numbers of the selected frames (K,).
    foreground: confidence that the robot covers a pixel, 0..1, at the working size (K, h, w).
    poses: of the parts in these frames (K, P, 4, 4).
    velocity: change of the parts' places (homogeneous) per row of the recording (K, P, 4, 4).
    moving: parts that move (P,), bool.
    size: width and height of the working pictures.
    few: indices into `rows` of the frames used by a search (k,).
    """

    name: str
    rows: np.ndarray
    foreground: np.ndarray
    poses: np.ndarray
    velocity: np.ndarray
    moving: np.ndarray
    size: tuple[int, int]
    few: np.ndarray

    def vertices(self, body: Body, few: bool = False, delay: float = 0.0) -> np.ndarray:
        """Vertices (K, V, 3), m, in the selected frames, or (few) those of a search; delay: of the pictures, rows."""
        poses = self.poses if delay == 0.0 else self.poses - delay * self.velocity @ self.poses
        return body.at(poses[self.few] if few else poses)


def working_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height at which pictures of this size are fitted."""
    width = min(max(size[0], WIDTHS[0]), WIDTHS[1])
    return width, max(round(size[1] * width / size[0]), 1)


def observe(footage: Footage, body: Body, size: tuple[int, int]) -> Observations:
    """Select frames that differ from each other and in which the robot is slow, and segment the robot in them.

    size: width and height that the pictures must have.
    Raises: VisionError when the robot does not move, no motion is visible, or frames differ in size.
    """
    markers = _markers(body)
    points = markers.at(footage.poses)
    travel = np.ptp(points, axis=0).max(axis=1)
    moving = np.array([travel[markers.part == k].max(initial=0.0) > STILL for k in range(len(body.names))])
    if not moving.any():
        raise VisionError(f"{footage.name}: the robot does not move; give a recording in which it does.")
    speed = np.linalg.norm(np.gradient(points, axis=0), axis=2).mean(axis=1)
    calm = 1.0 / (1.0 + (speed / max(float(np.median(speed)), 1e-6)) ** 2)
    rows = spread(points, SELECTED, calm)
    working = working_size(size)
    if footage.masks is None:
        wide = np.unique(np.r_[rows, spread(points, BACKGROUND, np.ones(len(points)))])
        pictures = np.stack([_scaled(_of_size(footage, row, size), working) for row in wide])
        foreground = foreground_of_motion(pictures)[np.searchsorted(wide, rows)]
    else:
        foreground = smooth(np.stack([_mask(footage, row, size, working) for row in rows]))
        if foreground.max() < 0.5:
            raise VisionError(
                f"{footage.name}: the masks are empty in the {len(rows)} selected frames; mark the robot in them."
            )
    if float(foreground.var(axis=0).mean()) < FAINT:
        raise VisionError(
            f"{footage.name}: nothing moves in the pictures, so no robot is visible; give other frames, or masks."
        )
    few = np.searchsorted(rows, spread(points[rows], SELECTED // 2, np.ones(len(rows)), rows))
    poses = footage.poses[rows]
    return Observations(footage.name, rows, foreground, poses, _velocity(footage.poses, rows), moving, working, few)


def _markers(body: Body) -> Body:
    """A few vertices of every part, as a body without proper faces."""
    each = max(MARKERS // len(body.names), 3)
    keep = np.zeros(len(body.vertices), bool)
    for k in np.unique(body.part):
        own = np.flatnonzero(body.part == k)
        keep[own[np.linspace(0, len(own) - 1, min(each, len(own))).astype(int)]] = True
    return Body(body.vertices[keep], np.zeros((1, 3), int), body.part[keep], body.names)


def _velocity(poses: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Change of each part's pose per row; multiplied by homogeneous points, it gives their velocity."""
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(poses) - 1)
    return (poses[after] - poses[before]) / (after - before)[:, None, None, None] @ np.linalg.inv(poses[rows])


def _of_size(footage: Footage, row: int, size: tuple[int, int]) -> np.ndarray:
    picture = footage.frame(row)
    if picture.shape[:2] != (size[1], size[0]):
        raise VisionError(
            f"{footage.name}: frame {row} is {picture.shape[1]} x {picture.shape[0]}, others {size[0]} x {size[1]}; "
            "give frames of one size."
        )
    return picture


def _mask(footage: Footage, row: int, size: tuple[int, int], working: tuple[int, int]) -> np.ndarray:
    mask = np.asarray(footage.masks[int(row)])  # pyright: ignore[reportOptionalSubscript]
    if mask.shape != (size[1], size[0]):
        raise VisionError(
            f"{footage.name}: mask {row} is {_describe(mask)}, but must be ({size[1]}, {size[0]}) like the frames."
        )
    return _scaled((mask != 0).astype(np.float32), working)


def _scaled(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    smaller = size[0] < picture.shape[1]
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)


def _describe(array: Any) -> str:
    return f"{array.dtype} of shape {array.shape}"


def bounding_sphere(body: Body, poses: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius, m, of the sphere that contains 90 % of the moving points over time.

    Raises: VisionError when nothing moves.
    """
    markers = _markers(body).at(poses)
    moving = np.ptp(markers, axis=0).max(axis=1) > STILL
    if not moving.any():
        raise VisionError("the robot does not move in any recording; give some in which it does.")
    points = markers[:, moving].reshape(-1, 3)
    middle = np.median(points, axis=0)
    return middle, float(np.quantile(np.linalg.norm(points - middle, axis=1), 0.9))
