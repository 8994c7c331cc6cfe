"""What moves is found from the true frames alone; noise does not move."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import moving_region, static_background, unclassed_region
from embodiedreamer_gym.vis_aligner.metrics.regions import numbers_of


def clip(width: int = 128, count: int = 2) -> tuple[np.ndarray, np.ndarray]:
    frames = np.full((count, 96, width, 3), 120, np.uint8)
    return frames, np.ones(frames.shape[:3], np.uint8)


def test_noise_of_a_sensor_does_not_move() -> None:
    rng = np.random.default_rng(0)
    frames, classes = clip(count=6)
    noisy = np.clip(frames + rng.normal(0, 2, frames.shape), 0, 255).astype(np.uint8)
    assert not moving_region(noisy[1:], classes[1:], noisy[0], classes[0]).any()


@pytest.mark.parametrize(("width", "radius"), [(64, 1), (128, 2), (320, 5)])
def test_a_class_that_changed_moves_with_a_margin_of_the_width(width: int, radius: int) -> None:
    frames, classes = clip(width)
    classes[1, 40, 30] = 3
    moved = moving_region(frames[1:], classes[1:], frames[0], classes[0])[0]
    rows, columns = np.nonzero(moved)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (
        40 - radius,
        40 + radius,
        30 - radius,
        30 + radius,
    )


def test_a_shadow_moves_and_a_thing_that_left_does() -> None:
    frames, classes = clip()
    frames[1, 50:60, 20:40] = 100  # a shadow: same class
    classes[0, 10:20, 80:90] = 3  # stood in the reference
    moved = moving_region(frames[1:], classes[1:], frames[0], classes[0])[0]
    assert moved[50:60, 20:40].all() and moved[10:20, 80:90].all()
    assert not moved[70:].any() and moved.mean() < 0.06
    faint = frames.copy()
    faint[1] = 110
    assert not moving_region(faint[1:], classes[:1], frames[0], classes[0]).any()


def test_background_that_stands_still_is_neither_class_nor_motion() -> None:
    frames, classes = clip()
    classes[:, :20] = 2
    classes[0, 60:70, 60:70] = 3
    moved = moving_region(frames[1:], classes[1:], frames[0], classes[0])
    still = static_background(classes[1:], classes[0], moved)
    assert not still[:, :20].any() and not still[:, 60:70, 60:70].any() and still[0, 30:50, :50].all()
    with pytest.raises(VisionError, match="of one size"):
        static_background(classes[1:], classes[0], moved[..., 1:])


def test_regions_by_class_names() -> None:
    names = ("background", "table", "robot", "pen", "holder")
    assert numbers_of(names) == {
        "robot": (2,), "pen": (3,), "holder": (4,), "objects": (3, 4), "arm and objects": (2, 3, 4),
    }  # fmt: skip
    assert "objects" not in numbers_of(names[:3])
    for bad in (names[:2], (*names, "pen"), (*names, "objects")):
        with pytest.raises(VisionError, match="class names"):
            numbers_of(bad)


def test_a_thing_without_class_is_found_and_a_shadow_is_not() -> None:
    rng, size = np.random.default_rng(0), (48, 64)
    background = np.clip(rng.normal(0, 2, (20, *size, 3)) + np.array([180.0, 160.0, 120.0]), 0, 255)
    classes = np.ones((20, *size), np.uint8)
    background[:, 30:, :16] *= np.linspace(1.0, 0.5, 20)[:, None, None, None]  # a shadow that deepens
    classes[:, :8, 40:] = 2  # the arm, and its edge that is drawn a pixel too narrow
    background[:, :9, 39:] = (60, 60, 64)
    thing = np.zeros((20, *size), bool)
    for t in range(20):  # something red that is pushed
        thing[t, 20:26, 10 + 2 * t : 16 + 2 * t] = True
    background[thing] = (200, 40, 40)
    found = unclassed_region(background.astype(np.uint8), classes)
    assert found[thing].mean() > 0.95 and found[~thing].mean() < 0.02
    classes[thing] = 3
    assert not unclassed_region(background.astype(np.uint8), classes).any()
