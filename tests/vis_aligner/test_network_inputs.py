"""What a network gets to see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_dilation

from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, Condition
from embodiedreamer_gym.vis_aligner.network_inputs import (
    Inputs,
    allowed,
    frame_channels,
    reference_channels,
    reprojected_pixels,
    to_frames,
    to_tensor,
)
from tests.vis_aligner.scenes import episode

OFF = [
    Inputs(),
    *(
        replace(Inputs(), **{name: False})
        for name in ("masks", "depth", "anchor", "plate", "at_reference", "reproject", "gallery")
    ),
]


@pytest.mark.parametrize("inputs", OFF, ids=str)
def test_as_many_channels_as_it_says(inputs: Inputs) -> None:
    one = episode()
    frame = frame_channels(one.condition, inputs)
    clip = reference_channels(one.references(4), inputs)
    assert frame.shape == (17, inputs.per_frame, 48, 64) and clip.shape == (inputs.per_clip, 48, 64)
    assert torch.isfinite(frame).all() and frame.abs().max() <= 1 and clip.abs().max() <= 1


def test_an_object_shows_only_as_its_mask() -> None:
    """Whatever colour or depth the simulator gives it, as of a real clip only its mask is known."""
    one = episode().condition
    thing = one.classes >= OBJECT
    other = Condition(np.where(thing[..., None], 77, one.rgb), one.classes, np.where(thing, 0.1, one.depth))
    frame = frame_channels(one, Inputs())
    assert torch.equal(frame[:, :6], frame_channels(other, Inputs())[:, :6])
    found = frame[:, 4:6].numpy() > 0
    assert np.array_equal(found[:, 0], one.classes == 3) and np.array_equal(found[:, 1], one.classes == 4)


def test_what_is_uncovered_comes_from_the_plate() -> None:
    one = episode(3)
    references, condition = one.references(8), one.condition.part(9, 17)
    shown = to_frames(reprojected_pixels(references, condition, replace(Inputs(), anchor=False)).still)
    before = references.last_condition.classes[0] >= ROBOT
    for frame, classes in zip(shown, condition.classes, strict=True):
        near, nearer = (binary_dilation(mask, np.ones((3, 3))) for mask in (before, classes >= ROBOT))
        left = (before & (classes < ROBOT)) | (near & ~nearer)  # an edge of a real thing may be a pixel wider
        new = left & references.seen
        assert np.array_equal(frame[new], references.plate[new]) and np.array_equal(frame[~new], references.last[~new])
    without = reprojected_pixels(references, condition, replace(Inputs(), plate=False, anchor=False)).still
    assert np.array_equal(to_frames(without)[-1], references.last)


def test_frames_survive_the_way_there_and_back() -> None:
    frames = episode().frames
    assert np.array_equal(to_frames(to_tensor(frames)), frames)


def test_without_masks_an_object_leaves_no_trace() -> None:
    """Erased, not blanked: a hole of its shape would be a mask."""
    one = episode().condition
    inputs = replace(Inputs(), masks=False)
    frame = frame_channels(allowed(one, inputs), inputs).numpy()
    table = frame[:, :3, 20, 0].mean(axis=0)
    cup = (one.classes == 3) & (np.arange(64) < 50)
    assert np.abs(frame[:, :3].transpose(1, 0, 2, 3)[:, cup] - table[:, None]).mean() < 0.15
