"""An edit reaches all that tells the colours: first frame, anchor, and what is behind things."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.editing import Background, Recolour, draws_of, edited, masks_of
from tests.vis_aligner.editing.room import classes, references
from tests.vis_aligner.scenes import NAMES

CUP, FREE = classes() == 3, classes() < 2


def test_a_background_is_in_the_plate_too() -> None:
    """Behind the cup the table is known, and gets the colour that the table around it gets."""
    start = references()
    done = edited(start, Background(("table",)), 1, names=NAMES)
    assert done.last is done.anchor and not np.array_equal(done.last, start.last)
    assert np.array_equal(done.seen, start.seen) and not done.plate[~done.seen].any()
    around = FREE & (classes() == 1)
    before, after = start.plate.astype(float), done.plate.astype(float)
    assert np.abs(after - before)[CUP].mean() > 10
    assert after[CUP].mean(axis=0) == pytest.approx(after[around].mean(axis=0), rel=0.25)
    assert np.abs(after - done.last)[around].mean() < 3  # frame and plate agree where both show the table


def test_a_recoloured_object_leaves_the_plate_alone() -> None:
    start = references()
    done = edited(start, Recolour(), 1, names=NAMES)
    assert np.array_equal(done.plate, start.plate)
    changed = (done.last != start.last).any(axis=2)
    assert np.array_equal(changed, classes() >= 3) and np.array_equal(done.anchor, done.last)


def test_a_later_start_keeps_its_own_anchor() -> None:
    start = references()
    later = replace(start, last=(start.last // 2).astype(np.uint8))
    done = edited(later, Background(("table",)), 1, names=NAMES)
    assert np.array_equal(done.anchor, edited(start, Background(("table",)), 1, names=NAMES).anchor)
    assert not np.array_equal(done.last, done.anchor)


def test_an_editor_that_does_something_else_each_time() -> None:
    """As an image model may: the plate follows the first frame, also behind the cup."""
    calls = []

    def moody(image, masks, rng, prompt):
        calls.append(masks["cup"].any())
        new = image.copy()
        new[masks["table"]] = (new[masks["table"]] // 2) + ((0, 90, 0) if len(calls) == 1 else (90, 0, 90))
        return new.astype(np.uint8)

    start = references()
    done = edited(start, moody, 0, names=NAMES)
    assert calls == [True, False]
    change = done.plate.astype(float) - start.plate
    assert np.abs(change[FREE] - (done.last.astype(float) - start.last)[FREE]).max() <= 1
    near = change[classes() == 1].mean(axis=0)
    assert change[CUP].mean(axis=0) == pytest.approx(near, abs=12) and near[1] > near[0] + 40


def test_the_table_goes_on_behind_things() -> None:
    seen = {}

    def look(image, masks, rng, prompt):
        seen.update(masks)
        return image

    edited(references(), look, 0, names=NAMES)
    assert list(seen) == list(NAMES) and not any(seen[name].any() for name in ("robot", "cup", "mat"))
    whole = np.where(np.arange(48)[:, None] >= 16, True, False) & np.ones(64, bool)
    assert np.array_equal(seen["table"], whole) and np.array_equal(seen["background"], ~whole)


def test_draws_are_those_that_are_told() -> None:
    names = masks_of(references().anchor_condition, NAMES)
    assert draws_of(Recolour(), names, 4) == draws_of(Recolour(), names, 4) != draws_of(Recolour(), names, 5)
    with pytest.raises(VisionError, match="expected"):
        edited(references(), lambda *_: None, 0, names=NAMES)
