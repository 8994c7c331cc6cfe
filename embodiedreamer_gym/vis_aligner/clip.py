"""What the models see and make: conditions, references and episodes, as arrays."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.deprecation import renamed_arguments

TABLE, ROBOT, OBJECT, GOAL = 1, 2, 3, 4  # classes; 0 is the background, further props count as goals
CLASS_NAMES = ("background", "table", "robot", "object", "goal")
Array = np.ndarray
Window = tuple[slice, slice]  # rows and columns of a picture


@dataclass(frozen=True, eq=False)
class Condition:
    """What the simulator shows of T frames.

    rgb (T, H, W, 3) uint8; classes (T, H, W) uint8: 0 background, 1 table, 2 robot, 3 object, 4 goal; depth (T, H, W)
    float32, m, or None. Where an object is, a network is not shown rgb and depth: of real clips only its mask is known.
    parts (T, H, W) uint8: which rigid part is seen, from 1, 0 where none is or it is not known; projections (T, L, 3, 4) of
    the L parts: (u, v, 1) depth = projection (x, y, z, 1), m to pixels; both or none, and only with depth.
    Raises: VisionError where shapes or types differ.
    """

    rgb: Array
    classes: Array
    depth: Array | None = None
    parts: Array | None = None
    projections: Array | None = None

    def __post_init__(self) -> None:
        if self.rgb.ndim != 4 or self.rgb.shape[3] != 3 or self.rgb.dtype != np.uint8:
            raise VisionError(f"simulated frames must be (T, H, W, 3) uint8, not {self.rgb.shape} {self.rgb.dtype}.")
        for name, array in (("classes", self.classes), ("depth", self.depth), ("parts", self.parts)):
            if array is not None and array.shape != self.rgb.shape[:3]:
                raise VisionError(f"{name} must be {self.rgb.shape[:3]} as the simulated frames, not {array.shape}.")

        if (self.parts is None) != (self.projections is None) or (self.parts is not None and self.depth is None):
            raise VisionError("rigid parts need their projections and depth; give all three, or depth alone, or none.")
        if self.projections is not None and (
            self.projections.shape[2:] != (3, 4) or len(self.projections) != len(self.rgb)
        ):
            raise VisionError(f"projections must be ({len(self.rgb)}, L, 3, 4), not {self.projections.shape}.")

    def __len__(self) -> int:
        return len(self.rgb)

    def __repr__(self) -> str:
        return f"Condition({len(self)} frames of {self.size[0]} x {self.size[1]})"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.rgb.shape[2], self.rgb.shape[1]

    def part(self, start: int, end: int) -> Condition:
        """Frames start .. end - 1."""
        return self._cut(slice(start, end), (slice(None), slice(None)), self.projections)

    def crop(self, window: Window) -> Condition:
        """The part of all frames in a window."""
        corner = np.array([[1, 0, -(window[1].start or 0)], [0, 1, -(window[0].start or 0)], [0, 0, 1]], np.float32)
        return self._cut(slice(None), window, None if self.projections is None else corner @ self.projections)

    def _cut(self, times: slice, window: Window, projections: Array | None) -> Condition:
        where = (times, *window)
        return Condition(
            self.rgb[where], self.classes[where], None if self.depth is None else self.depth[where],
            None if self.parts is None else self.parts[where], None if projections is None else projections[times],
        )  # fmt: skip

    def without_parts(self, smallest: int = 0) -> Condition:
        """The condition with nothing known of the rigid parts of this class and those above it."""
        if self.parts is None or smallest == 0:
            return replace(self, parts=None, projections=None)
        return replace(self, parts=np.where(self.classes >= smallest, 0, self.parts))


def facings(condition: Condition) -> Array:
    """The camera's axis (T, L, 3) in the frame of each part: which side of it is seen."""
    axes = np.asarray(condition.projections, np.float32)[:, :, 2, :3]
    return axes / np.linalg.norm(axes, axis=2, keepdims=True)


@dataclass(frozen=True, eq=False)
class Gallery:
    """True pictures of moments at which the robot stood in different poses.

    frames (K, H, W, 3) uint8; condition: what the simulator shows of the same moments, with its parts.
    Raises: VisionError where they do not fit, or the parts are not known.
    """

    frames: Array
    condition: Condition

    def __post_init__(self) -> None:
        if self.frames.shape != self.condition.rgb.shape or self.condition.parts is None:
            raise VisionError(
                f"a gallery needs photos {self.condition.rgb.shape}, not {self.frames.shape}, and the parts they show."
            )

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def facings(self) -> Array:
        """Which side (K, L, 3) of each part each photo shows."""
        return facings(self.condition)

    @cached_property
    def visible(self) -> Array:
        """Pixels (K, L) of each part in each photo."""
        shown = np.asarray(self.condition.parts).reshape(len(self), -1).astype(np.intp)
        return np.stack([np.bincount(one, minlength=256)[1:] for one in shown])


@dataclass(frozen=True, eq=False)
class Bench:
    """What is known of a bench before an episode begins.

    picture (H, W, 3) uint8: what is behind robot and objects; seen (H, W) bool: where that is known; gallery: photos of the
    robot in other poses.

    Raises: VisionError where the sizes differ.
    """

    picture: Array
    seen: Array
    gallery: Gallery | None = None

    def __post_init__(self) -> None:
        if self.picture.dtype != np.uint8 or self.picture.shape != (*self.seen.shape, 3):
            raise VisionError(
                f"a bench's picture must be (H, W, 3) uint8 with (H, W) of where it is known, not {self.picture.shape} "
                f"{self.picture.dtype} with {self.seen.shape}."
            )

    def over(self, plate: Array, seen: Array) -> tuple[Array, Array]:
        """A plate (H, W, 3) and where it was seen (H, W), with the picture in front of it.

        Raises: VisionError where the sizes differ.
        """
        if self.seen.shape != seen.shape:
            raise VisionError(f"the bench's picture is {self.seen.shape}, the frames {seen.shape}; they must agree.")
        return np.where(self.seen[..., None], self.picture, plate), self.seen | seen


@dataclass(frozen=True, eq=False)
class References:
    """What a chunk starts from: the last real or generated frame, the anchor, and what has been seen behind things.

    last, anchor (H, W, 3) uint8; last_condition, anchor_condition: the simulator's view at those instants (T = 1); plate
    (H, W, 3) uint8: the newest picture of table and background, where they were ever seen; seen (H, W) bool: where;
    gallery: true pictures of the robot in other poses.
    The anchor is the true first frame and is never replaced.
    """

    last: Array
    last_condition: Condition
    anchor: Array
    anchor_condition: Condition
    plate: Array
    seen: Array
    gallery: Gallery | None = None

    @staticmethod
    def start(frame: Array, condition: Condition, bench: Bench | None = None) -> References:
        """References of an episode's first frame (H, W, 3) and the simulator's view of it; bench: what is known
        of it beforehand.

        Raises: VisionError when the sizes differ.
        """
        if frame.shape != condition.rgb.shape[1:] or frame.dtype != np.uint8:
            width, height = condition.size
            raise VisionError(
                f"the reference must be ({height}, {width}, 3) uint8 as the simulated frames, not {frame.shape} {frame.dtype}."
            )
        free = condition.classes[-1] < ROBOT
        first = condition.part(len(condition) - 1, len(condition))
        plate = np.where(free[..., None], frame, 0).astype(np.uint8)
        if bench is not None:
            plate, free = bench.over(plate, free)
        return References(frame, first, frame, first, plate, free, None if bench is None else bench.gallery)

    def after(self, frames: Array, condition: Condition) -> References:
        """References once frames (T, H, W, 3) have been shown: what they uncovered is kept, what was seen is not redrawn."""
        plate, seen = self.plate, self.seen
        for frame, classes in zip(frames, condition.classes, strict=True):
            new = ~seen & (classes < ROBOT)
            if new.any():
                plate, seen = np.where(new[..., None], frame, plate), seen | new
        return replace(
            self,
            last=frames[-1],
            last_condition=condition.part(len(condition) - 1, len(condition)),
            plate=plate,
            seen=seen,
        )

    def viewed(self, change: Callable[[Condition], Condition]) -> References:
        """The references with the simulator's views changed."""
        views = {key: change(getattr(self, key)) for key in ("last_condition", "anchor_condition")}
        return replace(self, **views)

    def crop(self, window: Window) -> References:
        """The part of everything in a window."""
        pictures = (self.last[window], self.last_condition.crop(window), self.anchor[window])
        anchored = self.anchor_condition.crop(window)
        return References(*pictures, anchored, self.plate[window], self.seen[window], self.gallery)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.last.shape[1], self.last.shape[0]


@renamed_arguments(look="appearance")
@dataclass(frozen=True, eq=False)
class Episode:
    """A clip with its truth: real frames (T, H, W, 3) uint8 and what the simulator shows of the same instants.

    clean: the frames without the sensor's noise, where known; class_names: what the classes' numbers mean; appearance:
    a name that episodes before the same bench, in the same light, share; bench: what is known of it, where that was made.
    Raises: VisionError when the sizes differ.
    """

    name: str
    frames: Array
    condition: Condition
    clean: Array | None = None
    class_names: tuple[str, ...] = CLASS_NAMES
    appearance: str = ""
    bench: Bench | None = None

    def __post_init__(self) -> None:
        if self.frames.shape != self.condition.rgb.shape or self.frames.dtype != np.uint8:
            raise VisionError(
                f"{self.name}: real frames are {self.frames.shape} {self.frames.dtype}, simulated ones "
                f"{self.condition.rgb.shape} uint8; they must agree."
            )

    def __len__(self) -> int:
        return len(self.frames)

    def __repr__(self) -> str:
        return f"Episode({self.name!r}, {len(self)} frames of {self.condition.size[0]} x {self.condition.size[1]})"

    @property
    def look(self) -> str:
        """The appearance by its name in version 0.1."""
        warnings.warn("Episode.look is deprecated; use Episode.appearance", DeprecationWarning, stacklevel=2)
        return self.appearance

    @cached_property
    def first_seen(self) -> Array:
        """The first frame (H, W) in which table or background shows at a pixel; T where none does."""
        free = self.condition.classes < ROBOT
        return np.where(free.any(axis=0), free.argmax(axis=0), len(self))

    def references(self, at: int, bench: Bench | None = None) -> References:
        """References of a chunk that follows frame `at`, as if all frames up to there had been shown; bench: what is
        known of it beforehand.
        """
        seen = self.first_seen <= at
        rows, columns = np.indices(seen.shape)
        plate = self.frames[np.minimum(self.first_seen, len(self) - 1), rows, columns]
        plate = np.where(seen[..., None], plate, 0).astype(np.uint8)
        if bench is not None:
            plate, seen = bench.over(plate, seen)
        part = self.condition.part
        gallery = None if bench is None else bench.gallery
        return References(self.frames[at], part(at, at + 1), self.frames[0], part(0, 1), plate, seen, gallery)
