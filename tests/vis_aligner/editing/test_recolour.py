"""Objects in other colours: nothing else, and still shaded."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.editing import Recolour, apply, draws_of
from embodiedreamer_gym.vis_aligner.editing.recolour import to_hsv
from tests.vis_aligner.editing.room import classes, masks, picture

IMAGE = picture(classes())


def hue(image: np.ndarray, name: str) -> float:
    return float(np.median(to_hsv(image[masks()[name]])[:, 0]))


def test_only_the_masks_change() -> None:
    done = apply(Recolour(), IMAGE, masks(), 0)
    changed = (done != IMAGE).any(axis=2)
    things = masks()["cup"] | masks()["mat"]
    assert changed[things].all() and not changed[~things].any()
    only = (apply(Recolour(("mat",)), IMAGE, masks(), 0) != IMAGE).any(axis=2)
    assert np.array_equal(only, masks()["mat"])


@pytest.mark.parametrize("seed", range(6))
def test_the_hue_turns_and_grey_takes_colour(seed: int) -> None:
    done = apply(Recolour(), IMAGE, masks(), seed)
    turn = abs((hue(done, "mat") - hue(IMAGE, "mat") + 180) % 360 - 180)
    assert turn > 55
    cup = to_hsv(done[masks()["cup"]])
    drawn = draws_of(Recolour(), masks(), seed)["cup"]
    assert to_hsv(IMAGE[masks()["cup"]])[:, 1].max() < 0.01 and cup[:, 1] == pytest.approx(
        drawn["saturation"], abs=0.03
    )


def test_light_and_shadow_stay() -> None:
    """The room's things are 0.7 times as bright below."""
    done = apply(Recolour(("cup",), (30, 60, 200)), IMAGE, masks(), 0)
    rows, columns = np.nonzero(masks()["cup"])
    value = to_hsv(done[rows, columns])[:, 2]
    below = rows >= np.median(rows)
    assert value[below].mean() / value[~below].mean() == pytest.approx(0.7, abs=0.02)


def test_a_colour_that_is_asked_for() -> None:
    done = apply(Recolour(("cup",), (30, 60, 200)), IMAGE, masks(), 0)
    wanted = to_hsv(np.array([[30, 60, 200]], np.uint8))[0]
    assert hue(done, "cup") == pytest.approx(wanted[0], abs=2)
    assert np.array_equal(done, apply(Recolour(("cup",), (30, 60, 200)), IMAGE, masks(), 9))


def test_a_name_that_the_scene_does_not_have() -> None:
    with pytest.raises(VisionError, match="no 'pen' to edit; it has background, table, robot, cup, mat"):
        apply(Recolour(("pen",)), IMAGE, masks(), 0)


def test_what_is_drawn_for_one_does_not_depend_on_what_is_in_view() -> None:
    away = masks(classes(cup=False))
    assert not away["cup"].any() and draws_of(Recolour(), away, 3) == draws_of(Recolour(), masks(), 3)
