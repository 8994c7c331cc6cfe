"""Reference banks: photos of an empty bench and of objects, from which the reference of any scene is composed."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.bench import bench_of, make_bench, make_robot_gallery
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode, References
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, OBJECT, ROBOT, Condition
from embodiedreamer_gym.vis_aligner.moving_bench import make_moving_bench
from embodiedreamer_gym.vis_aligner.moving_view import compose_view
from embodiedreamer_gym.vis_aligner.object_photos import photos_of_objects

MARGIN = 0.06  # of the width: how far around an object its shadow is copied with it
SLENDER = 1.5  # ratio of an outline's axes above which it is rotated, not only stretched
SMALLEST = 6  # pixels of an object that a photo of it must show
UNNAMED = CLASS_NAMES[OBJECT:]
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Entry:
    """A photo with the robot at rest and all objects in view.

    frame (H, W, 3) uint8; classes (H, W) uint8; joints (n,) in the action's units and poses, prop -> position m and
    quaternion xyzw (7,): where both are known, the simulator can be set to the same scene; props: names of the objects,
    in the order of their classes; UNNAMED fits any objects.
    """

    frame: Array
    classes: Array
    joints: Array | None = None
    poses: Mapping[str, Array] | None = None
    props: tuple[str, ...] = UNNAMED

    def options(self) -> dict[str, Any]:
        """Options for an environment's reset to the same scene.

        Raises: VisionError where joints or poses are not known.
        """
        if self.joints is None or not self.poses:
            raise VisionError("this photo's joints and object poses are not known; the simulator cannot be set to it.")
        return {"joint_positions": self.joints, "object_poses": dict(self.poses)}


@dataclass(frozen=True, eq=False)
class Bank:
    """Photos of a bench, with and without objects.

    plate (H, W, 3) uint8: the bench without objects, the robot at rest; entries: photos with objects; bench: what else
    is known about the bench, or None; moving: the same for cameras that move; props: names of the objects in a scene,
    see `of`.
    Raises: VisionError without a photo, or where sizes differ.
    """

    plate: Array
    entries: tuple[Entry, ...]
    bench: Bench | None = None
    moving: Bench | None = None
    props: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.entries:
            raise VisionError("a reference bank needs at least one photo with objects.")
        for entry in self.entries:
            if entry.frame.shape != self.plate.shape or entry.classes.shape != self.plate.shape[:2]:
                raise VisionError(
                    f"all photos of a bank must have one size; the plate has {self.plate.shape}, a photo {entry.frame.shape}."
                )

    def __repr__(self) -> str:
        return f"Bank({len(self.entries)} photos of {self.size[0]} x {self.size[1]})"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.plate.shape[1], self.plate.shape[0]

    def of(self, props: Sequence[str]) -> Bank:
        """The bank with only the photos that show these objects.

        Raises: VisionError where no photo does.
        """
        fitting = tuple(e for e in self.entries if e.props in (tuple(props), UNNAMED))
        if not fitting:
            shown = sorted({" and ".join(e.props) for e in self.entries})
            raise VisionError(
                f"no photo of the bank shows {' and '.join(props)}; there are photos of {'; '.join(shown)}. Make a bank of "
                "your own with `embodiedreamer vis bank`."
            )
        return replace(self, entries=fitting, props=tuple(props))

    def start(self, condition: Condition, entry: Entry | None = None) -> References:
        """References at an episode's start: a photo, or a picture composed from photos.

        Raises: VisionError when the sizes differ, or the camera moves and the bank has no photos by such a camera.
        """
        frame = entry.frame if entry is not None and not condition.moving_camera else self.compose(condition)
        bench = self.moving if condition.moving_camera else self.bench
        return References.start(frame, condition.part(0, 1), bench, (*CLASS_NAMES[:OBJECT], *self.props))

    def entry(self, number: int) -> Entry:
        """Photo number 0, 1, ...

        Raises: VisionError where there is none of that number.
        """
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < len(self.entries):
            raise VisionError(f"the bank has photos 0 .. {len(self.entries) - 1}, not {number!r}.")
        return self.entries[number]

    def compose(self, condition: Condition) -> Array:
        """A reference (H, W, 3) uint8 of the scene in a condition's first frame: the plate with the objects inserted.

        Each object is copied from the photo in which it was nearest, moved and rotated to fit its mask, with the shadow
        around it. For a camera that moves, see `compose_view`.
        Raises: VisionError when the sizes differ, or the camera moves and the bank has no photos by such a camera.
        """
        if condition.size != self.size:
            raise VisionError(
                f"the bank's photos are {self.size}, the simulated frames {condition.size}; they must agree."
            )
        if condition.moving_camera:
            if self.moving is None:
                raise VisionError(
                    "the bank has no photos of a moving camera; make it again with `embodiedreamer vis bank --moving`."
                )
            return compose_view(self.moving, condition, (*CLASS_NAMES[:OBJECT], *self.props))
        picture, classes = self.plate.astype(np.float32), condition.classes[0]
        for number in sorted(set(np.unique(classes[classes >= OBJECT]).tolist()), reverse=True):  # flat goals first
            mask = classes == number
            entry = self._nearest(mask, number)
            if entry is not None:
                picture = self._insert(picture, entry, number, mask, classes)
        return np.clip(np.round(picture), 0, 255).astype(np.uint8)

    def paint(self, condition: Condition) -> Array:
        """Deprecated: use `compose`."""
        warnings.warn("Bank.paint is deprecated; use Bank.compose", DeprecationWarning, stacklevel=2)
        return self.compose(condition)

    def _nearest(self, mask: Array, number: int) -> Entry | None:
        """The photo in which an object is nearest to its mask in position and size; None if no photo shows it."""
        wanted = _outline(mask)
        candidates = [
            (e, _outline(e.classes == number)) for e in self.entries if (e.classes == number).sum() >= SMALLEST
        ]
        if not candidates or mask.sum() < 1:
            return None
        return min(candidates, key=lambda pair: _apart(pair[1], wanted))[0]

    def _insert(self, picture: Array, entry: Entry, number: int, mask: Array, classes: Array) -> Array:
        """The picture with an object from a photo copied into its mask, and its shadow on table and background."""
        source = entry.classes == number
        matrix = _fit(_outline(source), _outline(mask))
        size = self.size
        moved = cv2.warpAffine(entry.frame, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        covered = cv2.warpAffine(source.astype(np.uint8), matrix, size, flags=cv2.INTER_NEAREST) > 0
        inside, lacking = mask & covered, mask & ~covered
        if not inside.any():
            colour = entry.frame[source].mean(axis=0)
            return np.where(mask[..., None], colour, picture)
        if lacking.any():
            moved = cv2.inpaint(moved, (~covered).astype(np.uint8), 3, cv2.INPAINT_TELEA)
        ratio = (entry.frame.astype(np.float32) + 1) / (self.plate.astype(np.float32) + 1)
        ratio = cv2.GaussianBlur(
            np.where((entry.classes < ROBOT)[..., None], ratio, 1.0).astype(np.float32), (0, 0), 0.8
        )
        ratio = cv2.warpAffine(ratio, matrix, size, flags=cv2.INTER_LINEAR, borderValue=(1.0, 1.0, 1.0))
        reach = max(1, round(MARGIN * size[0]))
        near = cv2.dilate(mask.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2)) > 0
        fade = np.clip(2.0 - 2.0 * _distance(mask) / reach, 0.0, 1.0)[..., None]
        shadow = picture * (1 + fade * (np.clip(ratio, 0.3, 1.1) - 1))
        out = np.where((near & ~mask & (classes < ROBOT))[..., None], shadow, picture)
        return np.where(mask[..., None], moved.astype(np.float32), out)


def make_bank(episodes: Sequence[Episode], poses: Sequence[Mapping[str, Array] | None] = (),
              joints: Sequence[Array | None] = (), more: Sequence[Episode] = (),
              moving: Sequence[Episode] = (), photos: Sequence[Episode] = ()) -> Bank:  # fmt: skip
    """A bank from the first frames of episodes that begin with the robot in the same pose.

    The plate is the median of the first frames, over pixels that show no object; it includes the robot.
    poses, joints: of the props and the robot at the first frames, where known; more: episodes of the same bench with
    any start, to know more of the bench; moving: episodes of the same bench by cameras that move with the robot; photos:
    episodes of the same bench with larger pictures, from which the photos of robot and objects are taken.
    Raises: VisionError without an episode, or where sizes differ.
    """
    if not episodes:
        raise VisionError("a reference bank needs at least one episode.")
    firsts = np.stack([e.frames[0] for e in episodes])
    classes = np.stack([e.condition.classes[0] for e in episodes])
    free = np.ma.masked_array(firsts, np.repeat((classes >= OBJECT)[..., None], 3, axis=3))
    plate = np.ma.median(free, axis=0)
    holes = np.ma.getmaskarray(plate)[..., 0]
    filled = np.round(plate.filled(0)).astype(np.uint8)
    here, elsewhere = _by_place(episodes, more)
    _check_photos(photos, episodes[0])
    bench = replace(make_bench(here, elsewhere), things=photos_of_objects(photos or episodes))
    if photos:
        bench = replace(bench, gallery=make_robot_gallery(photos))
    if holes.any():  # an object in every first frame: use the bench's picture, else inpaint
        seen_behind = holes & bench.seen
        filled[seen_behind] = bench.picture[seen_behind]
        filled = cv2.inpaint(filled, (holes & ~seen_behind).astype(np.uint8), 3, cv2.INPAINT_TELEA)
    entries = [
        Entry(frame, seen, joints[i] if joints else None, poses[i] if poses else None, episodes[i].class_names[OBJECT:])
        for i, (frame, seen) in enumerate(zip(firsts, classes, strict=True))
    ]
    return Bank(filled, tuple(entries), bench, make_moving_bench(moving) if moving else None)


def _by_place(episodes: Sequence[Episode], more: Sequence[Episode]) -> tuple[list[Episode], list[Episode]]:
    """The episodes with those of `more` whose camera is in the same place; and those whose camera is in another place.

    Raises: VisionError where the cameras of `episodes` are in several places, or `more` shows another bench.
    """
    place, bench = episodes[0].appearance, bench_of(episodes[0])
    for episode in episodes:
        if episode.appearance != place:
            raise VisionError(
                f"{episodes[0].name} and {episode.name} show two benches, or one bench from two camera places; a bank "
                "has one of each. Give the episodes of the other place with --more, which uses only their photos of "
                "the robot."
            )
    for episode in more:
        if bench_of(episode) != bench:
            raise VisionError(f"{episodes[0].name} and {episode.name} show two benches; a bank has only one.")
    elsewhere = [one for one in more if one.appearance != place]
    return [*episodes, *(one for one in more if one.appearance == place)], elsewhere


def _check_photos(photos: Sequence[Episode], of: Episode) -> None:
    """Check episodes whose larger pictures are used as photos beside those of `of`.

    Raises: VisionError if they show another bench, or differ in size, or are not a larger version of its pictures.
    """
    width, height = of.condition.size
    for episode in photos:
        size = episode.condition.size
        if bench_of(episode) != bench_of(of):
            raise VisionError(f"{of.name} and {episode.name} show two benches; a bank has only one.")
        if size != photos[0].condition.size or size[0] < width or size[0] * height != size[1] * width:
            raise VisionError(
                f"the photos of {episode.name} are {size[0]} x {size[1]}; they must all have one size, which is a multiple "
                f"of the bank's {width} x {height}."
            )


# ---- outlines --------------------------------------------------------------------------------------------------

Outline = tuple[Array, Array, Array]  # centre (2,) x y, axes (2, 2) as columns, half lengths (2,), longest first


def _outline(mask: Array) -> Outline:
    """Centre and axes of a mask's pixels."""
    points = np.argwhere(mask)[:, ::-1].astype(float)
    if len(points) == 0:
        return np.zeros(2), np.eye(2), np.ones(2)
    centre = points.mean(axis=0)
    spread = np.cov(points.T, bias=True) + np.eye(2) / 12 if len(points) > 1 else np.eye(2) / 12
    values, vectors = np.linalg.eigh(spread)
    return centre, vectors[:, ::-1], np.sqrt(values[::-1])


def _apart(a: Outline, b: Outline) -> float:
    """Dissimilarity of two outlines: their distance in pixels, plus a penalty for different sizes."""
    return float(np.linalg.norm(a[0] - b[0]) + 20 * np.abs(np.log(a[2] / b[2])).sum())


def _fit(source: Outline, target: Outline) -> Array:
    """The affine map (2, 3) from one outline to another; slender outlines are rotated, others only stretched."""
    (c0, u0, s0), (c1, u1, s1) = source, target
    if s0[0] / s0[1] > SLENDER and s1[0] / s1[1] > SLENDER:
        if u0[:, 0] @ u1[:, 0] < 0:  # the smaller of the two rotations
            u1 = -u1
        if np.linalg.det(u0) * np.linalg.det(u1) < 0:
            u1 = u1 * np.array([1.0, -1.0])
        linear = u1 @ np.diag(s1 / s0) @ u0.T
    else:
        linear = (u1 * s1) @ u1.T @ np.linalg.inv((u0 * s0) @ u0.T)
    return np.column_stack([linear, c1 - linear @ c0])


def _distance(mask: Array) -> Array:
    """Distance (H, W) of each pixel to a mask, pixels."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
