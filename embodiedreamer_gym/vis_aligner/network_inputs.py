"""Converts conditions and references to the input tensors of a network.

The paper adds the objects' masks pixel-wise to the picture of the robot. Here each class has its own channel, and the
object pixels of the picture are blank. The information is the same, without the ambiguity of the sum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, TABLE, Condition
from embodiedreamer_gym.vis_aligner.light import carried_light, relit
from embodiedreamer_gym.vis_aligner.reprojection import Change, Reprojected, reproject_gallery, reproject_objects

NEAR, REACH = 1.0, 0.5  # m; depths NEAR - REACH .. NEAR + REACH become -1 .. 1
EDGE = np.ones((3, 3), np.uint8)
SLOPE = 20.0 / 128  # slope channel per m of depth difference between pixels two apart and per pixel of picture width


@dataclass(frozen=True)
class Inputs:
    """Which inputs a model uses. An input that is off is not computed, so each ablation is one flag."""

    masks: bool = True
    """Mask channels of robot, object and goal; if off, objects are erased from the picture."""
    depth: bool = True
    """Depth and its two slopes."""
    anchor: bool = True
    """The true first frame."""
    plate: bool = True
    """The background seen so far behind robot and objects."""
    at_reference: bool = True
    """The simulated view at the time of each reference frame."""
    reproject: bool = True
    """Links and objects that have moved, reprojected from the pictures that show them."""
    gallery: bool = True
    """Also reproject links from photos of the robot in other poses."""

    @property
    def per_frame(self) -> int:
        """Number of channels of a frame's condition."""
        return 3 + 3 * self.masks + 3 * self.depth

    @property
    def sources(self) -> int:
        """Number of real pictures from which each frame can copy pixels: plate, anchor, gallery."""
        return self.plate + self.anchor + self.gallery

    @property
    def per_clip(self) -> int:
        """Number of channels of the references."""
        frames = 1 + self.anchor
        return 3 * frames + self.at_reference * frames * self.per_frame + 4 * self.plate


def allowed(condition: Condition, inputs: Inputs) -> Condition:
    """The condition reduced to what a model may see: no objects if masks are off, no parts if reprojection is off."""
    seen = condition if inputs.masks else without_objects(condition)
    return seen if inputs.reproject else seen.without_parts()


def frame_channels(condition: Condition, inputs: Inputs, width: int | None = None) -> Tensor:
    """Channels (T, C, H, W), float, of a condition; width: of the full picture in pixels, if this is a window of it."""
    thing = condition.classes >= OBJECT
    rgb = np.where(thing[..., None], 0.0, condition.rgb.astype(np.float32) / 127.5 - 1.0)
    parts = [rgb.transpose(0, 3, 1, 2)]
    if inputs.masks:
        classes = condition.classes
        parts.append(np.stack([classes == ROBOT, classes == OBJECT, classes > OBJECT], axis=1).astype(np.float32))
    if inputs.depth:
        parts.append(_depth_channels(condition, thing, width or condition.size[0]))
    return torch.from_numpy(np.ascontiguousarray(np.concatenate(parts, axis=1), np.float32))


def without_objects(condition: Condition) -> Condition:
    """The condition without objects: they are inpainted from their surroundings and classified as table."""
    thing = condition.classes >= OBJECT
    rgb, depth = condition.rgb.copy(), None if condition.depth is None else condition.depth.copy()
    for number in np.flatnonzero(thing.any(axis=(1, 2))):
        rgb[number] = cv2.inpaint(rgb[number], thing[number].astype(np.uint8), 3, cv2.INPAINT_TELEA)
        if depth is not None:
            depth[number] = cv2.inpaint(depth[number], thing[number].astype(np.uint8), 3, cv2.INPAINT_TELEA)
    bare = condition.without_parts(OBJECT)
    return replace(bare, rgb=rgb, classes=np.where(thing, TABLE, condition.classes).astype(np.uint8), depth=depth)


def _depth_channels(condition: Condition, thing: np.ndarray, width: int) -> np.ndarray:
    """Depth and its slopes (T, 3, H, W); zero at object pixels, and everywhere if the depth is not known."""
    t, h, w = condition.classes.shape
    if condition.depth is None:
        return np.zeros((t, 3, h, w), np.float32)
    metres = condition.depth.astype(np.float32)
    across, down = np.zeros_like(metres), np.zeros_like(metres)
    across[:, :, 1:-1] = metres[:, :, 2:] - metres[:, :, :-2]
    down[:, 1:-1] = metres[:, 2:] - metres[:, :-2]
    scale = SLOPE * width  # the same tilt has the same value at every picture size
    channels = np.stack([(metres - NEAR) / REACH, scale * across, scale * down], axis=1)
    return np.where(thing[:, None], 0.0, np.clip(channels, -1.0, 1.0))


def reference_channels(references: References, inputs: Inputs, width: int | None = None) -> Tensor:
    """Channels (C, H, W), float, of the references; width: of the full picture in pixels, if this is a window of it."""
    parts = [to_tensor(references.last)]
    views = [references.last_condition]
    if inputs.anchor:
        parts.append(to_tensor(references.anchor))
        views.append(references.anchor_condition)
    if inputs.plate:
        seen = torch.from_numpy(references.seen.astype(np.float32))[None]
        parts += [to_tensor(references.plate) * seen, seen]
    if inputs.at_reference:
        parts += [frame_channels(view, inputs, width)[0] for view in views]
    return torch.cat(parts)


@dataclass(frozen=True, eq=False)
class ReprojectedPixels:
    """Frames assembled from pictures taken at other times.

    still (T, 3, H, W): from the last frame and, where it does not show a pixel, from the other pictures.
    sources (T, S, 3, H, W): the same, but pixels come first from one real picture; S is Inputs.sources.
    stale (T, 1, H, W): 1 where a pixel of robot or object is in none of the pictures.
    """

    still: Tensor
    sources: Tensor
    stale: Tensor


def reprojected_pixels(references: References, condition: Condition, inputs: Inputs) -> ReprojectedPixels:
    """`reprojected_frames` as tensors."""
    still, sources, stale = reprojected_frames(references, condition, inputs)
    return ReprojectedPixels(to_tensor(still), to_tensor(sources), torch.from_numpy(stale)[:, None].float())


def reprojected_frames(
    references: References, condition: Condition, inputs: Inputs
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames assembled from pictures taken at other times: still, sources and stale.

    still (T, H, W, 3) uint8: the last frame. Pixels that robot or objects have left come from the plate where it is
    known. Rigid parts that have moved are reprojected from the last frame, else the anchor, else the gallery.
    sources (T, S, H, W, 3) uint8: plate, anchor and gallery, each completed with still where it shows nothing, so that
    pixels need not be copied from copies.
    stale (T, H, W) bool: pixels of robot or objects that are in none of the pictures.
    """
    before = references.last_condition
    thing = condition.classes >= ROBOT
    still = carried_light(references.last, before, condition)
    plate = references.plate if condition.shade is None else relit(references.plate, 1.0, condition.shade)
    if inputs.plate:
        left = references.seen & _left(before.classes[0] >= ROBOT, thing)
        _put(still, plate, left)
    since = Change(before, condition)
    colours, valid = since.reproject(references.last)
    _put(still, colours, valid)
    stale = since.differs & thing & ~valid
    others = []
    if inputs.anchor:
        since = Change(references.anchor_condition, condition)
        colours, valid = since.reproject(references.anchor)
        same = ~since.differs
        _put(colours, carried_light(references.anchor, references.anchor_condition, condition), same)
        others.append((colours, valid | same))
    if inputs.gallery:
        others.append(recalled(references, condition, stale))
    for colours, valid in others:
        _put(still, colours, stale & valid)
        stale &= ~valid
    if inputs.plate:
        others.insert(0, (plate, references.seen & ~thing))
    sources = [still.copy() for _ in others]
    for one, (colours, valid) in zip(sources, others, strict=True):
        _put(one, colours, valid)
    stacked = np.stack(sources, 1) if sources else still[:, None][:, :0]
    return still, stacked, stale


def recalled(references: References, condition: Condition, stale: np.ndarray) -> Reprojected:
    """Colours of the robot from the gallery, and of stale pixels (T, H, W) of objects from the photos of the objects."""
    colours, valid = reproject_gallery(references.gallery, condition)
    for shown, found in reproject_objects(references.things, condition, stale):
        _put(colours, shown, found)
        valid |= found
    return colours, valid


def _put(frames: np.ndarray, colours: np.ndarray, valid: np.ndarray) -> None:
    """Copy colours (T, H, W, 3) or (H, W, 3) into frames (T, H, W, 3) at the valid pixels (T, H, W)."""
    tall = (-1, *frames.shape[2:])  # all frames as one picture: OpenCV is ten times as fast as indexing
    source = np.ascontiguousarray(np.broadcast_to(colours, frames.shape)).reshape(tall)
    cv2.copyTo(source, valid.astype(np.uint8).reshape(tall[:2]), frames.reshape(tall))


def _left(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Pixels (T, H, W) that things (H, W) have left, with their edges, which may be a pixel wider in a real picture."""
    wide = cv2.dilate(before.astype(np.uint8), EDGE) > 0
    return np.stack([(before & ~one) | (wide & (cv2.dilate(one.astype(np.uint8), EDGE) == 0)) for one in now])


def to_tensor(frames: np.ndarray) -> Tensor:
    """Frames (..., H, W, 3) uint8 as (..., 3, H, W) in -1 .. 1."""
    return (
        torch.from_numpy(frames)
        .movedim(-1, -3)
        .to(torch.float32, memory_format=torch.contiguous_format)
        .div_(127.5)
        .sub_(1.0)
    )


def to_frames(clip: Tensor) -> np.ndarray:
    """(..., 3, H, W) in -1 .. 1 as frames (..., H, W, 3) uint8."""
    levels = ((clip.clamp(-1.0, 1.0) + 1.0) * 127.5).round().to(torch.uint8)
    return np.ascontiguousarray(levels.movedim(-3, -1).cpu().numpy())
