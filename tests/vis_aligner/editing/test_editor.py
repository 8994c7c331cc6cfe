"""What every edit has in common: it is drawn by a seed, told in words, and its result looked at."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.editing import Background, Chain, Recolour, apply, describe, draws_of
from embodiedreamer_gym.vis_aligner.editing.editor import things
from tests.vis_aligner.editing.room import classes, masks, picture

IMAGE = picture(classes())


def noisy(image, masks, rng, prompt):
    return rng.integers(0, 255, image.shape, dtype=np.uint8)


def test_a_seed_says_all() -> None:
    one, again, other = (apply(noisy, IMAGE, masks(), seed) for seed in (1, 1, 2))
    assert np.array_equal(one, again) and not np.array_equal(one, other)


def test_the_prompt_arrives_and_the_picture_stays_whole() -> None:
    heard = []

    def editor(image, masks, rng, prompt):
        heard.append((sorted(masks), prompt))
        image[:] = 0  # a careless one
        return image

    before = IMAGE.copy()
    assert not apply(editor, IMAGE, masks(), 0, "a marble table").any()
    assert np.array_equal(IMAGE, before)
    assert heard == [(["background", "cup", "mat", "robot", "table"], "a marble table")]


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (IMAGE[:-1], r"returned \(47, 64, 3\) uint8; a picture \(48, 64, 3\) uint8 is expected"),
        (IMAGE / 255, r"returned \(48, 64, 3\) float64"),
        (None, "returned NoneType"),
    ],
)
def test_a_bad_result_is_one_sentence(result, said: str) -> None:
    with pytest.raises(VisionError, match=said):
        apply(lambda *_: result, IMAGE, masks(), 0)
    with pytest.raises(VisionError, match=said):
        apply(Chain([Recolour(), lambda *_: result]), IMAGE, masks(), 0)


def test_a_chain_is_its_parts_each_with_draws_of_its_own() -> None:
    chain = Chain([Background(("table",)), Recolour(("cup",))])
    done = apply(chain, IMAGE, masks(), 5)
    changed = (done != IMAGE).any(axis=2)
    assert changed[masks()["cup"]].all() and changed[masks()["table"]].mean() > 0.9
    assert not changed[masks()["mat"] | masks()["robot"] | masks()["background"]].any()
    drawn = draws_of(chain, masks(), 5)
    assert [list(d) for d in drawn.values()] == [["table"], ["cup"]]
    first, second = draws_of(Chain([Recolour(), Recolour()]), masks(), 5).values()
    assert first != second
    assert draws_of(Chain([noisy, Recolour()]), masks(), 5)[f"1 {describe(noisy)}"] == {}


def test_words_are_the_same_in_every_run() -> None:
    assert describe(Chain([Recolour(("cup",)), noisy])) == (
        f"Chain([Recolour(names=('cup',), colour=None), {noisy.__module__}.noisy])"
    )


def test_things_are_robot_and_objects() -> None:
    assert np.array_equal(things(masks()), classes() >= 2)
