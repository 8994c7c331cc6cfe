"""Masks of objects in real frames."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.masks import coloured, masks_by, masks_in, no_masks
from tests.vis_aligner.scenes import episode


def test_masks_of_a_folder(tmp_path) -> None:
    one = episode()
    things = np.where(one.condition.classes >= 3, one.condition.classes, 0)
    for number, classes in enumerate(things[:3]):
        cv2.imwrite(str(tmp_path / f"{number:06d}.png"), classes)
    read = masks_in(tmp_path)
    assert all(np.array_equal(read(one.frames[k], k), things[k]) for k in range(3))
    with pytest.raises(VisionError, match=r"000003\.png"):
        read(one.frames[3], 3)
    with pytest.raises(VisionError, match="must agree"):
        read(one.frames[0, ::2], 0)
    with pytest.raises(VisionError, match="does not exist"):
        masks_in(tmp_path / "none")


def test_masks_by_a_function_and_by_colour() -> None:
    one = episode(noise=0.0)
    red = coloured({3: ((0, 150, 100), (8, 255, 255)), 4: ((105, 120, 80), (120, 255, 255))})
    found = red(one.frames[0], 0)
    for number in (3, 4):
        true = one.condition.classes[0] == number
        assert ((found == number) & true).sum() / ((found == number) | true).sum() > 0.9
    assert not no_masks(one.frames[0], 0).any()
    half = masks_by(lambda frame: 3 * (frame[..., 0] > 300))
    assert half(one.frames[0], 0).dtype == np.uint8
    with pytest.raises(VisionError, match=r"holds \[1\]"):
        masks_by(lambda frame: np.ones(frame.shape[:2], int))(one.frames[0], 0)
