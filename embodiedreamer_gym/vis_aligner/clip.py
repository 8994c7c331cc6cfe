"""The data that the models use: galleries, benches, references and episodes, as arrays."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, Array, Condition, Window, facings
from embodiedreamer_gym.vis_aligner.light import Light, relit, unshaded
from embodiedreamer_gym.vis_aligner.table_atlas import TableAtlas

MOST_GRAIN = 64.0  # of 255, largest standard deviation of the sensor's noise


@dataclass(frozen=True, eq=False)
class Gallery:
    """Real pictures of the robot in different poses.

    frames (K, H, W, 3) uint8; condition: the simulator's view at the same instants, with its parts.
    Raises: VisionError where shapes differ, or the parts are not known.
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
        """Viewing direction (K, L, 3) of each photo in the frame of each part."""
        return facings(self.condition)

    @cached_property
    def visible(self) -> Array:
        """Number of pixels (K, 255) of each part in each photo."""
        shown = np.asarray(self.condition.parts).reshape(len(self), -1).astype(np.intp)
        return np.stack([np.bincount(one, minlength=256)[1:] for one in shown])


@dataclass(frozen=True, eq=False)
class Bench:
    """What is known about a bench before an episode begins.

    picture (H, W, 3) uint8: the background behind robot and objects; seen (H, W) bool: where it is known; gallery:
    photos of the robot in other poses; light: its light sources (if given, the picture has no shadows on the table);
    grain: standard deviation of the sensor's noise, of 255; atlas: the table, for a camera that moves; things: photos
    of each object, by its name, each with the object as its only part.

    Raises: VisionError where the sizes differ, or the grain is out of range.
    """

    picture: Array
    seen: Array
    gallery: Gallery | None = None
    light: Light | None = None
    grain: float | None = None
    atlas: TableAtlas | None = None
    things: Mapping[str, Gallery] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.grain is not None and not 0 <= self.grain <= MOST_GRAIN:
            raise VisionError(f"a sensor's grain must be from 0 to {MOST_GRAIN:.0f} of 255, not {self.grain:.4g}.")
        if self.light is not None and self.light.receivers.shape != self.seen.shape:
            raise VisionError(
                f"a bench of {self.seen.shape} needs light of that size, not {self.light.receivers.shape}."
            )
        if self.picture.dtype != np.uint8 or self.picture.shape != (*self.seen.shape, 3):
            raise VisionError(
                "a bench's picture must be (H, W, 3) uint8 with a mask (H, W) of its known pixels, not "
                f"{self.picture.shape} {self.picture.dtype} with {self.seen.shape}."
            )

    def over(self, plate: Array, seen: Array) -> tuple[Array, Array]:
        """A plate (H, W, 3) and its known pixels (H, W), overwritten by the bench's picture where that is known.

        Raises: VisionError where the sizes differ.
        """
        if self.seen.shape != seen.shape:
            raise VisionError(f"the bench's picture is {self.seen.shape}, the frames {seen.shape}; they must agree.")
        return np.where(self.seen[..., None], self.picture, plate), self.seen | seen

    def lit(self, condition: Condition) -> Condition:
        """The condition with its shade added, if the light is known."""
        return condition if self.light is None else self.light.on(condition)

    def photos_of(self, class_names: Sequence[str]) -> dict[int, Gallery]:
        """Photos of the objects by class number; objects without photos are left out."""
        return {number: self.things[name] for number, name in enumerate(class_names) if name in self.things}


@dataclass(frozen=True, eq=False)
class References:
    """What a chunk starts from: the last real or generated frame, the anchor, and the background seen so far.

    last, anchor (H, W, 3) uint8; last_condition, anchor_condition: the simulator's view at those instants (T = 1);
    plate (H, W, 3) uint8: table and background, each pixel from the bench's picture or as first seen; seen (H, W) bool:
    where the plate is known; gallery: real pictures of the robot in other poses; light: of the bench (if given, the
    plate has no shadows on the table, and the views have their shade); atlas: the table, for a camera that moves;
    things: photos of the objects, by class number.
    The anchor is the true first frame and is never replaced.
    """

    last: Array
    last_condition: Condition
    anchor: Array
    anchor_condition: Condition
    plate: Array
    seen: Array
    gallery: Gallery | None = None
    light: Light | None = None
    atlas: TableAtlas | None = None
    things: Mapping[int, Gallery] = field(default_factory=dict)

    @staticmethod
    def start(
        frame: Array, condition: Condition, bench: Bench | None = None, class_names: Sequence[str] = ()
    ) -> References:
        """References at an episode's first frame (H, W, 3), with the simulator's view of it.

        bench: what is known beforehand; class_names: names of the class numbers, to find the objects in the bench.
        Raises: VisionError when the sizes differ.
        """
        if frame.shape != condition.rgb.shape[1:] or frame.dtype != np.uint8:
            width, height = condition.size
            raise VisionError(
                f"the reference must be ({height}, {width}, 3) uint8 like the simulated frames, not {frame.shape} {frame.dtype}."
            )
        free = condition.free[-1]
        first = condition.part(len(condition) - 1, len(condition))
        if bench is None:
            return References(frame, first, frame, first, np.where(free[..., None], frame, 0).astype(np.uint8), free)
        first = bench.lit(first)
        plate = np.where(free[..., None], unshaded(frame, first), 0).astype(np.uint8)
        plate, seen = bench.over(plate, free)
        return References(frame, first, frame, first, plate, seen, **_known(bench, class_names))

    def lit(self, condition: Condition) -> Condition:
        """The condition with its shade added, if the light is known."""
        return condition if self.light is None else self.light.on(condition)

    def after(self, frames: Array, condition: Condition) -> References:
        """References after frames (T, H, W, 3): the plate gains what they uncover and keeps what it already shows."""
        plate, seen = self.plate, self.seen
        for number, (frame, free) in enumerate(zip(frames, condition.free, strict=True)):
            new = ~seen & free
            if new.any():
                shown = unshaded(frame, self.lit(condition.part(number, number + 1)))
                plate, seen = np.where(new[..., None], shown, plate), seen | new
        last = self.lit(condition.part(len(condition) - 1, len(condition)))
        return replace(self, last=frames[-1], last_condition=last, plate=plate, seen=seen)

    def viewed(self, change: Callable[[Condition], Condition]) -> References:
        """The references with `change` applied to the simulator's views."""
        views = {key: change(getattr(self, key)) for key in ("last_condition", "anchor_condition")}
        return replace(self, **views)

    def crop(self, window: Window) -> References:
        """The references with pictures and views cropped to a window."""
        pictures = (self.last[window], self.last_condition.crop(window), self.anchor[window])
        anchored = self.anchor_condition.crop(window)
        known = (self.gallery, self.light, self.atlas, self.things)
        return References(*pictures, anchored, self.plate[window], self.seen[window], *known)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.last.shape[1], self.last.shape[0]


@renamed_arguments(look="appearance")
@dataclass(frozen=True, eq=False)
class Episode:
    """A clip with its ground truth: real frames (T, H, W, 3) uint8 and the simulator's view at the same instants.

    clean: the frames without the sensor's noise, if known; class_names: names of the class numbers; appearance: a name
    shared by episodes of the same bench in the same light; bench: what is known about the bench, if available.
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
        """Deprecated: the name of `appearance` in version 0.1."""
        warnings.warn("Episode.look is deprecated; use Episode.appearance", DeprecationWarning, stacklevel=2)
        return self.appearance

    @cached_property
    def first_seen(self) -> Array:
        """Number (H, W) of the first frame in which each pixel shows table or background; T if none does."""
        free = self.condition.free
        return np.where(free.any(axis=0), free.argmax(axis=0), len(self))

    def lit(self, bench: Bench | None) -> Episode:
        """The episode with the shade of all its frames in the bench's light; unchanged if there is no shade to add."""
        condition = self.condition if bench is None else bench.lit(self.condition)
        return self if condition is self.condition else replace(self, condition=condition)

    def references(self, at: int, bench: Bench | None = None) -> References:
        """References for a chunk that follows frame `at`, as if all frames up to it had been shown.

        bench: what is known beforehand. If the bench has a light, call `lit` first; otherwise every call computes the
        shade of all frames, which is slow.
        """
        if (lit := self.lit(bench)) is not self:
            return lit.references(at, bench)
        seen = self.first_seen <= at
        rows, columns = np.indices(seen.shape)
        first = np.minimum(self.first_seen, len(self) - 1)
        plate = self.frames[first, rows, columns]
        if self.condition.shade is not None:
            plate = relit(plate, self.condition.shade[first, rows, columns], 1.0)
        plate = np.where(seen[..., None], plate, 0).astype(np.uint8)
        if bench is not None:
            plate, seen = bench.over(plate, seen)
        part = self.condition.part
        known = {} if bench is None else _known(bench, self.class_names)
        return References(self.frames[at], part(at, at + 1), self.frames[0], part(0, 1), plate, seen, **known)


def _known(bench: Bench, class_names: Sequence[str]) -> dict[str, Any]:
    """What references copy from a bench besides its picture."""
    return {"gallery": bench.gallery, "light": bench.light, "atlas": bench.atlas,
            "things": bench.photos_of(class_names)}  # fmt: skip
