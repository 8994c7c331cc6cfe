"""What is filmed: which steps, from which seed, and what cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.standin.film.settings import MAX_EVERY, MIN_FRAMES, STEPS, FilmSettings

TASK = "PutCupOnMat"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": "PutCup"}, "no task 'PutCup'; give one of GrabPaperCup, PutPenInCup, PutRemoteInBox, PutCupOnMat"),
        ({"appearance": "blue"}, "no appearance 'blue'; give lab, many"),
        ({"size": (8, 96)}, "8 x 96 pixels; each may be 16 to 2048"),
        ({"size": (128, 4000)}, "128 x 4000 pixels"),
        ({"seed": -1}, "seed is -1, but must be at least 0"),
        ({"frames": 9}, "frames is 9, but must be at least 10"),
        ({"every": 0}, "every is 0, but must be at least 1"),
        ({"every": 34}, "every is 34, but must be at most 33"),
        ({"samples": 0}, "samples is 0"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(changes: dict, message: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=message) as error:
        FilmSettings(**{"task": TASK, **changes})
    assert str(error.value).endswith(".") and "\n" not in str(error.value)


def test_every_episode_has_a_seed_and_a_place_of_its_own() -> None:
    seeds = {FilmSettings(task, seed=seed).episode_seed(n) for task in TASKS for seed in range(5) for n in range(5)}
    assert len(seeds) == 100
    assert FilmSettings(TASK, frames=20).episode_seed(3) == FilmSettings(TASK, "many", (64, 48)).episode_seed(3)
    assert FilmSettings(TASK).path(Path("films"), 7) == Path("films/PutCupOnMat_007.hdf5")


def test_settings_are_all_that_a_file_depends_on() -> None:
    film = FilmSettings(TASK, "many", (64, 48), 3, 20, 2, 8)
    settings = film.as_dict(5)
    assert settings == json.loads(json.dumps(settings))
    others = [{"appearance": "lab"}, {"size": (48, 48)}, {"seed": 4}, {"frames": None}, {"every": 1}, {"samples": 4}]
    base = {"task": TASK, "appearance": "many", "size": (64, 48), "seed": 3, "frames": 20, "every": 2, "samples": 8}
    assert all(FilmSettings(**{**base, **other}).as_dict(5) != settings for other in others)
    assert film.as_dict(6) != settings


def test_the_steps_of_a_whole_episode() -> None:
    np.testing.assert_array_equal(FilmSettings(TASK).choose_steps(200, 0), np.arange(200))
    np.testing.assert_array_equal(FilmSettings(TASK, every=3).choose_steps(200, 0), np.arange(0, 200, 3))
    np.testing.assert_array_equal(FilmSettings(TASK, frames=500).choose_steps(200, 0), np.arange(200))


def test_a_stretch_begins_at_random_where_things_move() -> None:
    film = FilmSettings(TASK, frames=30, every=3)
    chosen = [film.choose_steps(200, number) for number in range(40)]
    assert all(len(steps) == 30 and set(np.diff(steps)) == {3} for steps in chosen)
    firsts = [steps[0] for steps in chosen]
    assert min(firsts) < 30 and max(firsts) > 80 and max(steps[-1] for steps in chosen) < 200
    np.testing.assert_array_equal(film.choose_steps(200, 5), chosen[5])


@pytest.mark.parametrize("every", [1, 7, MAX_EVERY])
@pytest.mark.parametrize("active_steps", [1, 15, STEPS])
@pytest.mark.parametrize("frames", [None, MIN_FRAMES])
def test_a_short_episode_is_long_enough_for_a_recording(every: int, active_steps: int, frames: int | None) -> None:
    steps = FilmSettings(TASK, every=every, frames=frames).choose_steps(active_steps, 0)
    assert len(steps) >= MIN_FRAMES and steps[0] >= 0 and steps[-1] < STEPS
