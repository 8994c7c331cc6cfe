"""The same seed gives the same episode, bit for bit, whatever went before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from embodiedreamer_gym.envs import NAMES
from embodiedreamer_gym.envs.aloha import AlohaEnv
from tests.envs.moves import drain, shove
from tests.envs.test_randomize import calibrated

# Hands pressed into the table, where PyBullet's memory of the last contacts shows most.
LEANING = np.array([0.0, 2.1, -0.9, 0.0, 0.6, 0.0, 0.5] * 2)


def episode(env: gym.Env, seed: int, steps: int, options: dict | None = None) -> list[Any]:
    """Everything that an episode of contacts returns."""
    return [env.reset(seed=seed, options=options), *shove(env, np.random.default_rng(seed), steps)]


def same_after_any_past(steps: int, pasts: int, options: dict | None = None, **arguments) -> None:
    """Compare episodes of new environments with those of one that has a past.

    PyBullet remembers contacts between things that are put back to where they touched, so half the pasts began alike.
    """
    old = AlohaEnv(**arguments)
    for past in range(pasts):
        rng = np.random.default_rng(100 + past)
        old.reset(seed=past + 100 * (past % 2), options=options)
        drain(shove(old, rng, int(rng.integers(5, 60))))
        new = AlohaEnv(**arguments)
        seen = [episode(env, past, steps, options) for env in (new, old)]
        new.close()
        assert data_equivalence(*seen, exact=True), f"another episode after {past + 1} others"
        assert any(step[-1]["distance"] != seen[0][0][-1]["distance"] for step in seen[0])
    old.close()


@pytest.mark.parametrize("task", NAMES)
def test_states(task: str) -> None:
    same_after_any_past(180, 4, task=task, obs_type="state")


@pytest.mark.parametrize("renderer", ["tiny", "auto"])
def test_pictures(renderer: str) -> None:
    same_after_any_past(12, 2, cameras=("head", "left_wrist"), image_size=(144, 120), renderer=renderer)


def test_drawn_parameters(tmp_path: Path) -> None:
    same_after_any_past(36, 3, obs_type="state", robot=calibrated(tmp_path), randomize="calibration")


def test_starts_in_contact() -> None:
    options = {"joint_positions": LEANING}
    env = AlohaEnv(obs_type="state")
    env.reset(seed=0, options=options)
    env.step(LEANING)
    assert env.engine.client.getContactPoints(bodyA=env.engine.table, bodyB=env.engine.plant.ids[0])
    env.close()
    same_after_any_past(24, 6, options, obs_type="state")


def test_the_past_of_another_environment_does_not_matter() -> None:
    one, two, alone = (AlohaEnv(obs_type="state") for _ in range(3))
    wanted = episode(alone, 7, 36)
    one.reset(seed=7), two.reset(seed=8)
    turns = zip(shove(one, np.random.default_rng(7), 36), shove(two, np.random.default_rng(9), 36), strict=True)
    assert data_equivalence(wanted[1:], [step for step, _ in turns], exact=True)
    for env in (one, two, alone):
        env.close()


def test_another_seed_is_another_episode() -> None:
    env = AlohaEnv(obs_type="state")
    starts = np.array([env.reset(seed=seed)[0] for seed in range(8)])
    assert len(np.unique(starts[:, 34:37], axis=0)) == 8  # where the object stands
    assert set(starts[:, -1]) == {-1.0, 1.0}  # either arm acts
    first, second = env.reset(seed=0)[0], env.reset()[0]
    assert not np.array_equal(first, second)
    env.close()
