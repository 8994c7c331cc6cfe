"""Table and background in other looks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.editing import Background, apply, draws_of
from embodiedreamer_gym.vis_aligner.editing.background import HUES, PATTERNS
from embodiedreamer_gym.vis_aligner.editing.recolour import to_hsv
from tests.vis_aligner.editing.room import classes, masks, picture

IMAGE = picture(classes())


@pytest.mark.parametrize("seed", range(4))
def test_things_are_not_touched(seed: int) -> None:
    done = apply(Background(), IMAGE, masks(), seed)
    changed = (done != IMAGE).any(axis=2)
    assert not changed[classes() >= 2].any() and changed[classes() < 2].mean() > 0.9
    table = (apply(Background(("table",)), IMAGE, masks(), seed) != IMAGE).any(axis=2)
    assert not table[classes() != 1].any()


def test_it_has_the_colour_that_was_drawn() -> None:
    for seed in range(4):
        drawn = draws_of(Background(), masks(), seed)["table"]
        found = to_hsv(apply(Background(), IMAGE, masks(), seed)[masks()["table"]])
        assert HUES[0] <= drawn["hue"] <= HUES[1]
        assert np.median(found[:, 0]) == pytest.approx(drawn["hue"], abs=6)
        assert np.median(found[:, 1]) == pytest.approx(drawn["saturation"], abs=0.03)


def test_shadows_stay() -> None:
    dark = IMAGE.copy()
    dark[20:24, 4:12] //= 2
    done, lit = (apply(Background(("table",)), i, masks(), 0)[20:24, 4:12].astype(float) for i in (dark, IMAGE))
    assert done.mean() / lit.mean() == pytest.approx(0.5, abs=0.06)


def test_every_pattern_is_drawn() -> None:
    assert {draws_of(Background(), masks(), seed)["table"]["pattern"] for seed in range(40)} == set(PATTERNS)


def test_a_users_pictures(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "blue.png"), np.full((10, 40, 3), (250, 20, 10), np.uint8))
    editor = Background(("table",), tmp_path)
    done = apply(editor, IMAGE, masks(), 0)
    table = done[masks()["table"]].astype(float)
    assert (table[:, 2] > 5 * table[:, 0]).all() and draws_of(editor, masks(), 0)["table"]["picture"] == "blue.png"
    (tmp_path / "blue.png").write_bytes(b"no picture")
    with pytest.raises(VisionError, match=r"blue\.png is not a readable image"):
        apply(editor, IMAGE, masks(), 0)


def test_what_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(VisionError, match="holds no pictures for a background"):
        Background(pictures=tmp_path)
    with pytest.raises(VisionError, match="background must be background or table, not 'robot'"):
        Background(("robot",))
