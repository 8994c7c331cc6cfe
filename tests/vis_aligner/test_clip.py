"""Conditions, references and what has been seen behind moving things."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode, References
from embodiedreamer_gym.vis_aligner.condition import ROBOT, Condition
from tests.vis_aligner.scenes import episode


def test_references_of_an_episode_are_those_of_playing_it() -> None:
    """`references(at)` is what `after` arrives at frame by frame."""
    one = episode(1)
    played = References.start(one.frames[0], one.condition.part(0, 1))
    for k in range(1, 9):
        played = played.after(one.frames[k : k + 1], one.condition.part(k, k + 1))
    there = one.references(8)
    assert np.array_equal(there.seen, played.seen) and np.array_equal(there.plate, played.plate)
    assert np.array_equal(there.last, one.frames[8]) and np.array_equal(there.anchor, one.frames[0])
    assert there.seen.sum() > one.references(0).seen.sum()


def test_the_former_name_of_appearance_works_with_a_warning() -> None:
    one = episode(1)
    with pytest.warns(DeprecationWarning, match="'look' of Episode is now 'appearance'"):
        named = Episode("a", one.frames, one.condition, look="dim")
    with pytest.warns(DeprecationWarning, match="use Episode.appearance"):
        assert named.look == named.appearance == "dim"


def test_what_was_seen_is_not_redrawn() -> None:
    """The plate keeps the first sight of a pixel, whatever is shown later."""
    one = episode(2)
    before = one.references(0)
    after = before.after(np.full_like(one.frames[1:5], 255), one.condition.part(1, 5))
    assert np.array_equal(after.plate[before.seen], before.plate[before.seen])
    new = after.seen & ~before.seen
    assert new.any() and (after.plate[new] == 255).all()
    assert not (after.seen & (one.condition.classes[:5] >= ROBOT).all(axis=0)).any()
    assert (after.anchor == one.frames[0]).all() and (after.last == 255).all()


def test_a_backdrop_shows_what_this_episode_never_uncovered() -> None:
    """And goes before what the episode showed itself; what neither knows stays unknown."""
    one = episode(2)
    seen = np.zeros((48, 64), bool)
    seen[:, 20:] = True
    bench = Bench(np.full((48, 64, 3), 99, np.uint8), seen)
    without, found = one.references(0), one.references(0, bench)
    assert (found.plate[seen] == 99).all() and np.array_equal(found.plate[~seen], without.plate[~seen])
    assert np.array_equal(found.seen, seen | without.seen) and (found.seen & ~without.seen).any()
    started = References.start(one.frames[0], one.condition.part(0, 1), bench)
    assert np.array_equal(started.plate, found.plate) and np.array_equal(started.seen, found.seen)
    with pytest.raises(VisionError, match="must agree"):
        one.references(0, Bench(bench.picture[::2], seen[::2]))
    with pytest.raises(VisionError, match="a bench's picture must be"):
        Bench(bench.picture, seen[::2])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"rgb": np.zeros((2, 48, 64), np.uint8)}, "must be"),
        ({"rgb": np.zeros((17, 48, 64, 3))}, "uint8"),
        ({"classes": np.zeros((17, 48, 60), np.uint8)}, r"\(17, 48, 64\).*\(17, 48, 60\)"),
        ({"depth": np.zeros((16, 48, 64), np.float32)}, "depth"),
    ],
)
def test_pictures_that_do_not_fit_are_refused(change, says) -> None:
    one = episode().condition
    with pytest.raises(VisionError, match=says):
        Condition(**({"rgb": one.rgb, "classes": one.classes, "depth": one.depth} | change))


def test_a_reference_of_another_camera_is_refused() -> None:
    one = episode()
    with pytest.raises(VisionError, match=r"\(48, 64, 3\).*\(96, 128, 3\)"):
        References.start(np.zeros((96, 128, 3), np.uint8), one.condition.part(0, 1))
    with pytest.raises(VisionError, match="must agree"):
        Episode("short", one.frames[:5], one.condition)
