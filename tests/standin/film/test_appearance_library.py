"""A look is the same for the same seed, has all that a scene needs, and hides nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.standin.film.appearance import Look
from embodiedreamer_gym.standin.film.appearance_library import draw_look, find_look
from embodiedreamer_gym.standin.film.geometry import prop_parts
from embodiedreamer_gym.standin.film.lab import lab
from embodiedreamer_gym.standin.film.materials import PATTERNS

LOOKS = [lab(), *(draw_look(seed) for seed in range(40))]
EDGE = TABLE_CENTRE[0] + TABLE.size[0] / 2  # m ahead, where the table ends


def test_a_seed_draws_one_look_and_another_seed_another() -> None:
    assert draw_look(4) == draw_look(4) == find_look("many", 4) == find_look("4", 99)
    assert find_look("lab", 1) == find_look("lab", 2) == lab()
    tables = {look.surfaces["table"] for look in LOOKS}
    assert len(tables) == len(LOOKS)
    assert len({look.surfaces["table"].pattern for look in LOOKS}) >= 5


@pytest.mark.parametrize("text", ["labs", "-1", "", "1.5"])
def test_other_looks_are_refused(text: str) -> None:
    with pytest.raises(VisionError, match="give lab, many, or a whole number"):
        find_look(text, 0)


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: look.name)
def test_a_look_is_whole(look: Look) -> None:
    """Surfaces for everything that may stand there, of known patterns and colours; fit for JSON."""
    needed = {"table", "floor", "wall", "skirting", "deck", "legs", "shell", "housing", "accent", "pad"}
    needed |= {part.paint for task in TASKS.values() for prop in task().props for part in prop_parts(prop, 3)}
    needed |= {block.surface for block in look.blocks}
    assert needed <= set(look.surfaces)
    for surface in look.surfaces.values():
        assert surface.pattern in PATTERNS and surface.scale > 0.0
        assert all(0.0 <= channel <= 1.0 for colour in surface.colours for channel in colour)
    assert json.loads(json.dumps(look.as_dict()))["lens"]["barrel"] == look.lens.barrel
    assert -0.05 <= look.lens.barrel <= 0.0 and look.lamps


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: look.name)
def test_nothing_in_the_room_hides_the_bench(look: Look) -> None:
    """Things stand behind the table, below the camera, out of reach of the arms."""
    head = CAMERAS["head"].position[2]
    for block in look.blocks:
        reach = 0.5 * np.hypot(*block.size[:2])
        assert block.position[0] - reach > EDGE
        assert block.position[2] + block.size[2] / 2 < head - 0.2
    assert look.wall > EDGE + 0.5


def test_things_differ_from_the_table_they_stand_on() -> None:
    alike = 0
    for look in LOOKS:
        for name in ("cup", "mat", "pen", "holder", "remote", "box"):
            away = np.abs(np.subtract(look.surfaces[name].colours[0], look.surfaces["table"].colours[0])).sum()
            alike += away < 0.4
    assert alike < 0.05 * len(LOOKS) * 6
