"""The ground truth of generated clips: the true clip with its classes, and quantities that depend on these alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_classes, check_frames, check_picture, clip_size
from embodiedreamer_gym.vis_aligner.metrics.regions import moving_region, numbers_of, static_background
from embodiedreamer_gym.vis_aligner.metrics.segmenter import Segmenter, mask_iou
from embodiedreamer_gym.vis_aligner.metrics.video_features import I3d, random_features


@dataclass(frozen=True, eq=False, repr=False)
class GroundTruth:
    """A true clip, without its reference frame.

    frames: (T, H, W, 3), uint8 RGB; classes: (T, H, W), uint8; reference: (H, W, 3), the true frame before the first,
    and its classes (H, W); class_names: of the class numbers: background, table, robot, then the props.
    segmenter: segments pictures into classes; by default learnt from this clip and its reference.
    Raises: VisionError when sizes differ, or there are not enough class names.
    """

    frames: np.ndarray
    classes: np.ndarray
    reference: np.ndarray
    reference_classes: np.ndarray
    class_names: tuple[str, ...]
    segmenter: Segmenter | None = None

    def __post_init__(self) -> None:
        frames = check_frames(self.frames, "true frames")
        first = np.asarray(self.reference_classes)
        for name, value in {
            "frames": frames,
            "classes": check_classes(self.classes, frames),
            "reference": check_picture(self.reference, frames),
            "reference_classes": check_classes(first[None], frames[:1], "classes of the reference")[0],
            "class_names": tuple(self.class_names),
        }.items():
            object.__setattr__(self, name, value)
        numbers_of(self.class_names)
        greatest = max(int(self.classes.max()), int(self.reference_classes.max()))
        if greatest >= len(self.class_names):
            raise VisionError(
                f"class {greatest} is in the pictures, but there are names for 0 .. {len(self.class_names) - 1}."
            )

    def __repr__(self) -> str:
        return f"GroundTruth({clip_size(self.frames)}, {', '.join(self.class_names[2:])})"

    @cached_property
    def numbers(self) -> dict[str, tuple[int, ...]]:
        """Class numbers by region: robot, each prop, objects, arm and objects."""
        return numbers_of(self.class_names)

    @cached_property
    def moving(self) -> np.ndarray:
        """Pixels (T, H, W), bool, that differ from the reference; see `moving_region`."""
        return moving_region(self.frames, self.classes, self.reference, self.reference_classes)

    @cached_property
    def still(self) -> np.ndarray:
        """Pixels (T, H, W), bool, of static background; see `static_background`."""
        return static_background(self.classes, self.reference_classes, self.moving)

    @cached_property
    def learnt(self) -> Segmenter:
        """The segmenter: the given one, or one learnt from the reference and this clip."""
        if self.segmenter is not None:
            return self.segmenter
        frames = np.concatenate([self.reference[None], self.frames])
        return Segmenter.learn(frames, np.concatenate([self.reference_classes[None], self.classes]))

    @cached_property
    def ceiling(self) -> dict[str, float | None]:
        """IoU that the true frames themselves reach, by region; None for a region without true pixels."""
        segmented = self.find(self.frames)
        return {name: self.iou(segmented, numbers) for name, numbers in self.numbers.items()}

    @cached_property
    def random_features(self) -> np.ndarray:
        """Features (n, 64) for rfvd."""
        return random_features(self.frames)

    def find(self, frames: np.ndarray) -> np.ndarray:
        """Classes (T, H, W) segmented in frames (T, H, W, 3) by their colours."""
        return self.learnt.segment(frames, self.classes, self.reference_classes)

    def iou(self, segmented: np.ndarray, numbers: tuple[int, ...]) -> float | None:
        """Intersection over union of segmented and true classes over the clip, mean over classes with true pixels.

        None if no class has any. All classes have the same weight, so a pen counts as much as the box beside it.
        """
        shares = [mask_iou(segmented, self.classes, number) for number in self.seen(numbers)]
        return float(np.mean(shares)) if shares else None

    def seen(self, numbers: tuple[int, ...]) -> tuple[int, ...]:
        """The class numbers that have at least one true pixel."""
        return tuple(number for number in numbers if (self.classes == number).any())

    def mask(self, numbers: tuple[int, ...]) -> np.ndarray:
        """Pixels (T, H, W), bool, of these classes."""
        return np.isin(self.classes, numbers)

    def i3d_features(self, network: I3d) -> np.ndarray:
        """Features (n, D) for FVD, cached by the network's path."""
        kept = self.__dict__.setdefault("_i3d", {})
        if network.path not in kept:
            kept[network.path] = network.features(self.frames)
        return kept[network.path]
