"""The simulator's view of a clip, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError

BACKGROUND, TABLE, ROBOT, OBJECT, GOAL = 0, 1, 2, 3, 4  # classes; further props count as goals
CLASS_NAMES = ("background", "table", "robot", "object", "goal")
Array = np.ndarray
Window = tuple[slice, slice]  # rows and columns of a picture
WHOLE: Window = (slice(None), slice(None))
PICTURES = ("rgb", "classes", "depth", "parts", "shade")  # fields of a condition with shape (T, H, W, ...)


@dataclass(frozen=True, eq=False)
class Condition:
    """The simulator's view of T frames.

    rgb (T, H, W, 3) uint8; classes (T, H, W) uint8: 0 background, 1 table, 2 robot, 3 object, 4 goal; depth (T, H, W)
    float32, m, or None. Networks do not get rgb and depth at object pixels: real clips have only the objects' masks.
    parts (T, H, W) uint8: number of the rigid part at each pixel, from 1; 0 if there is none or it is not known;
    projections (T, L, 3, 4) of the L parts: (u, v, 1) depth = projection (x, y, z, 1), m to pixels; both or none, and
    only with depth.
    hulls (L, P, 3) float32: points of each part's convex hull, m in its frame, or None; shade (T, H, W) float32: ratio,
    0 to 1, of a table pixel's value to its value without shadows of the parts, see `Light`, or None.
    Raises: VisionError where shapes or types differ.
    """

    rgb: Array
    classes: Array
    depth: Array | None = None
    parts: Array | None = None
    projections: Array | None = None
    hulls: Array | None = None
    shade: Array | None = None

    def __post_init__(self) -> None:
        if self.rgb.ndim != 4 or self.rgb.shape[3] != 3 or self.rgb.dtype != np.uint8:
            raise VisionError(f"simulated frames must be (T, H, W, 3) uint8, not {self.rgb.shape} {self.rgb.dtype}.")
        for name, array in (("classes", self.classes), ("depth", self.depth), ("parts", self.parts),
                            ("shade", self.shade)):  # fmt: skip
            if array is not None and array.shape != self.rgb.shape[:3]:
                raise VisionError(f"{name} must be {self.rgb.shape[:3]} like the simulated frames, not {array.shape}.")

        if (self.parts is None) != (self.projections is None) or (self.parts is not None and self.depth is None):
            raise VisionError("rigid parts need their projections and depth; give all three, or depth alone, or none.")
        if self.projections is not None and (
            self.projections.shape[2:] != (3, 4) or len(self.projections) != len(self.rgb)
        ):
            raise VisionError(f"projections must be ({len(self.rgb)}, L, 3, 4), not {self.projections.shape}.")
        if self.hulls is not None and (
            self.projections is None or self.hulls.ndim != 3 or self.hulls.shape[2:] != (3,)
            or len(self.hulls) != self.projections.shape[1]
        ):  # fmt: skip
            count = 0 if self.projections is None else self.projections.shape[1]
            raise VisionError(f"hulls must be ({count}, P, 3), one for each rigid part, not {self.hulls.shape}.")

    def __len__(self) -> int:
        return len(self.rgb)

    def __repr__(self) -> str:
        return f"Condition({len(self)} frames of {self.size[0]} x {self.size[1]})"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.rgb.shape[2], self.rgb.shape[1]

    @property
    def free(self) -> Array:
        """Pixels (T, H, W) of table and background that are not parts; with a moving camera they are parts."""
        around = self.classes < ROBOT
        return around if self.parts is None else around & (self.parts == 0)

    @property
    def moving_camera(self) -> bool:
        """Whether the camera moves, so that table and background are parts."""
        return self.projections is not None and bool(_far(self.projections[:1]).any())

    def part(self, start: int, end: int) -> Condition:
        """Frames start .. end - 1."""
        return self._cut(slice(start, end), WHOLE, self.projections)

    def at(self, frames: Sequence[int]) -> Condition:
        """These frames, in this order."""
        return self._cut(frames, WHOLE, self.projections)

    def crop(self, window: Window) -> Condition:
        """All frames, cropped to a window."""
        corner = np.array([[1, 0, -(window[1].start or 0)], [0, 1, -(window[0].start or 0)], [0, 0, 1]], np.float32)
        return self._cut(slice(None), window, None if self.projections is None else corner @ self.projections)

    def _cut(self, times: slice | Sequence[int], window: Window, projections: Array | None) -> Condition:
        arrays = {name: getattr(self, name) for name in PICTURES}
        pictures: dict[str, Any] = {k: None if x is None else x[times][:, *window] for k, x in arrays.items()}
        return Condition(projections=None if projections is None else projections[times], hulls=self.hulls, **pictures)

    @staticmethod
    def joined(clips: Sequence[Condition]) -> Condition:
        """Conditions of the same parts, concatenated in time."""
        fields = {name: [getattr(clip, name) for clip in clips] for name in (*PICTURES, "projections")}
        joined: dict[str, Any] = {
            name: None if any(x is None for x in arrays) else np.concatenate(arrays) for name, arrays in fields.items()
        }
        return Condition(hulls=clips[0].hulls, **joined)

    def only(self, number: int) -> Condition | None:
        """The condition with the object of a class as its only part; None unless the object is visible as one part."""
        of_object = self.classes == number
        found = np.unique(np.asarray(self.parts)[of_object]) if self.parts is not None else np.zeros(1, np.uint8)
        if len(found) != 1 or not found[0]:
            return None
        shown = np.asarray(self.projections)[:, int(found[0]) - 1][:, None]
        return replace(self, parts=of_object.astype(np.uint8), projections=shown, hulls=None)

    def without_parts(self, smallest: int = 0) -> Condition:
        """The condition without the rigid parts of class `smallest` and higher classes; 0 removes all parts."""
        if self.parts is None or smallest == 0:
            return replace(self, parts=None, projections=None, hulls=None)
        return replace(self, parts=np.where(self.classes >= smallest, 0, self.parts))


def facings(condition: Condition) -> Array:
    """The camera's viewing direction (T, L, 3) in the frame of each part, that is, which side of it is seen."""
    axes = np.asarray(condition.projections, np.float32)[:, :, 2, :3]
    return axes / np.linalg.norm(axes, axis=2, keepdims=True)


def _far(projections: Array) -> Array:
    """Which parts (L,) are infinitely far: turning the camera moves them in the picture, carrying it does not."""
    return np.any(projections[..., :3], axis=(0, 2, 3)) & ~np.any(projections[..., 3], axis=(0, 2))
