"""An appearance is the same for the same seed, has all that a scene needs, and hides nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.standin.film.appearance import Appearance
from embodiedreamer_gym.standin.film.appearance_library import draw_appearance, find_appearance
from embodiedreamer_gym.standin.film.geometry import prop_parts
from embodiedreamer_gym.standin.film.lab import lab
from embodiedreamer_gym.standin.film.materials import PATTERNS

APPEARANCES = [lab(), *(draw_appearance(seed) for seed in range(40))]
EDGE = TABLE_CENTRE[0] + TABLE.size[0] / 2  # m ahead, where the table ends


def test_a_seed_draws_one_appearance_and_another_seed_another() -> None:
    assert draw_appearance(4) == draw_appearance(4) == find_appearance("many", 4) == find_appearance("4", 99)
    assert find_appearance("lab", 1) == find_appearance("lab", 2) == lab()
    tables = {appearance.surfaces["table"] for appearance in APPEARANCES}
    assert len(tables) == len(APPEARANCES)
    assert len({appearance.surfaces["table"].pattern for appearance in APPEARANCES}) >= 5


@pytest.mark.parametrize("text", ["labs", "-1", "", "1.5"])
def test_other_appearances_are_refused(text: str) -> None:
    with pytest.raises(VisionError, match="give lab, many, or a whole number"):
        find_appearance(text, 0)


@pytest.mark.parametrize("appearance", APPEARANCES, ids=lambda appearance: appearance.name)
def test_an_appearance_is_whole(appearance: Appearance) -> None:
    """Surfaces for everything that may stand there, of known patterns and colours; fit for JSON."""
    needed = {"table", "floor", "wall", "skirting", "deck", "legs", "shell", "housing", "accent", "pad"}
    needed |= {part.material for task in TASKS.values() for prop in task().props for part in prop_parts(prop, 3)}
    needed |= {block.surface for block in appearance.blocks}
    assert needed <= set(appearance.surfaces)
    for surface in appearance.surfaces.values():
        assert surface.pattern in PATTERNS and surface.scale > 0.0
        assert all(0.0 <= channel <= 1.0 for colour in surface.colours for channel in colour)
    assert json.loads(json.dumps(appearance.as_dict()))["lens"]["barrel"] == appearance.camera_noise.barrel
    assert -0.05 <= appearance.camera_noise.barrel <= 0.0 and appearance.lamps


@pytest.mark.parametrize("appearance", APPEARANCES, ids=lambda appearance: appearance.name)
def test_nothing_in_the_room_hides_the_bench(appearance: Appearance) -> None:
    """Things stand behind the table, below the camera, out of reach of the arms."""
    head = CAMERAS["head"].position[2]
    for block in appearance.blocks:
        reach = 0.5 * np.hypot(*block.size[:2])
        assert block.position[0] - reach > EDGE
        assert block.position[2] + block.size[2] / 2 < head - 0.2
    assert appearance.wall > EDGE + 0.5


def test_things_differ_from_the_table_they_stand_on() -> None:
    alike = 0
    for appearance in APPEARANCES:
        for name in ("cup", "mat", "pen", "holder", "remote", "box"):
            away = np.abs(
                np.subtract(appearance.surfaces[name].colours[0], appearance.surfaces["table"].colours[0])
            ).sum()
            alike += away < 0.4
    assert alike < 0.05 * len(APPEARANCES) * 6
