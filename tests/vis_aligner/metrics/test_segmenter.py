"""Classes are found again by their colours: true frames reach a high IoU, a thing that is missing or wrong a low one."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import Segmenter, mask_iou
from embodiedreamer_gym.vis_aligner.metrics.segmenter import UNKNOWN, search_areas

ROBOT, CUP, MAT = 2, 3, 4


@pytest.fixture(scope="module")
def segmenter(bench) -> Segmenter:
    return Segmenter.learn(bench.frames[::2], bench.classes[::2])


def iou(segmenter: Segmenter, bench, frames: np.ndarray, number: int) -> float:
    return mask_iou(segmenter.segment(frames, bench.classes), bench.classes, number)


def with_cup(bench, change) -> np.ndarray:
    """Frames in which the pixels of the cup are changed."""
    return np.where((bench.classes == CUP)[..., None], change, bench.frames).astype(np.uint8)


@pytest.mark.parametrize("number", [ROBOT, CUP, MAT])
def test_true_frames_reach_a_high_ceiling(segmenter: Segmenter, bench, number: int) -> None:
    unseen = segmenter.segment(bench.frames[1::2], bench.classes[1::2])
    assert mask_iou(unseen, bench.classes[1::2], number) > 0.93


def test_the_cup_is_found_in_spite_of_blur_noise_and_a_little_colour(segmenter: Segmenter, bench) -> None:
    rng = np.random.default_rng(0)
    rough = np.clip(bench.frames + rng.normal(0, 8, bench.frames.shape) + np.array((6, -4, 5)), 0, 255).astype(np.uint8)
    assert iou(segmenter, bench, rough, CUP) > 0.85


@pytest.mark.parametrize(
    ("what", "most"),
    [
        ("missing", 0.01),
        ("ghost", 0.3),
        ("another colour", 0.01),
        ("a class of its own", 0.01),
        ("the first frame", 0.45),
    ],
)
def test_a_thing_that_is_not_right_is_not_found(segmenter: Segmenter, bench, what: str, most: float) -> None:
    frames = {
        "missing": lambda: with_cup(bench, bench.plate),
        "ghost": lambda: with_cup(bench, 0.5 * bench.plate + 0.5 * bench.frames),
        "another colour": lambda: with_cup(bench, bench.frames[..., [1, 2, 0]]),
        "a class of its own": lambda: with_cup(bench, (40, 70, 160)),  # the mat's colour
        "the first frame": lambda: np.broadcast_to(bench.frames[0], bench.frames.shape),
    }[what]()
    assert iou(segmenter, bench, frames, CUP) < most
    if what != "the first frame":
        assert iou(segmenter, bench, frames, ROBOT) > 0.93  # the others are none the worse for it


def test_a_cup_left_behind_counts_against_the_one_at_its_place(segmenter: Segmenter, bench) -> None:
    late = bench.frames[8:].copy()
    place = bench.classes[0] == CUP
    late[:, place] = np.where((bench.classes[8:, place] == ROBOT)[..., None], late[:, place], bench.frames[0][place])
    alone = segmenter.segment(bench.frames[8:], bench.classes[8:], bench.classes[0])
    both = segmenter.segment(late, bench.classes[8:], bench.classes[0])
    assert mask_iou(alone, bench.classes[8:], CUP) > 0.93
    assert mask_iou(both, bench.classes[8:], CUP) < 0.75


def test_a_colour_nobody_has_is_unknown(segmenter: Segmenter, bench) -> None:
    green = np.broadcast_to(np.array((30, 255, 30), np.uint8), bench.frames.shape)
    assert (segmenter.segment(green, bench.classes) == UNKNOWN).all()


def test_a_shadow_never_seen_before_is_background(segmenter: Segmenter, bench) -> None:
    dark = bench.frames.copy()
    dark[:, 5:20, 10:40] = (0.6 * dark[:, 5:20, 10:40]).astype(np.uint8)
    assert (segmenter.segment(dark, bench.classes)[:, 6:19, 11:39] == 0).mean() > 0.97


def test_a_class_is_looked_for_where_it_has_been() -> None:
    classes = np.zeros((2, 100, 200), np.uint8)
    classes[0, 50, 20] = classes[1, 50, 100] = 3
    reference = np.zeros((100, 200), np.uint8)
    reference[20, 180] = 4
    areas = search_areas(classes, reference)
    assert sorted(areas) == [3, 4]
    assert areas[3][50, [8, 32, 88, 112]].all() and not areas[3][50, [7, 33, 60]].any()  # 0.06 x 200 pixels
    assert areas[4][20, 180] and not areas[4][50, 100]


def test_what_it_cannot_do_is_refused(segmenter: Segmenter, bench) -> None:
    with pytest.raises(VisionError, match="trained on 96x72"):
        segmenter.segment(bench.frames[:, ::2], bench.classes[:, ::2])
    with pytest.raises(VisionError, match=r"classes \[7\] are unknown"):
        segmenter.segment(bench.frames, np.where(bench.classes == 3, 7, bench.classes).astype(np.uint8))
    with pytest.raises(VisionError, match="no pixel of the classes is background"):
        Segmenter.learn(bench.frames[:1], np.full_like(bench.classes[:1], 2))
    with pytest.raises(VisionError, match="no pixel has class 9"):
        mask_iou(bench.classes, bench.classes, 9)
    assert repr(segmenter) == "Segmenter(classes 0, 2, 3, 4, 96x72)"
