"""Commands through a calibrated model, in the environments."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import ModelError, SimulationError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.tracking import Tracker
from embodiedreamer_gym.wrappers import ActionChunk, CalibratedTracking
from tests.bank import plain

ID = "embodiedreamer_gym:EmbodieDreamer/PutCupOnMat-v0"
ARM = np.array([True] * 6 + [False] + [True] * 6 + [False])


@pytest.fixture(scope="module")
def rough(tmp_path_factory: pytest.TempPathFactory) -> str:
    """File of the ALOHA robot with friction."""
    model = RobotModel.load("aloha")
    path = tmp_path_factory.mktemp("robot") / "rough.json"
    model.with_effect(plain(model, CATALOGUE["coulomb_friction"])).save(path)
    return str(path)


def make(robot: str) -> gym.Env:
    return gym.make(ID, obs_type="state", robot=robot, disable_env_checker=True)


def motion(count: int = 60) -> np.ndarray:
    """Both arms go to and fro above the table (count, 14)."""
    time = np.arange(1, count + 1)[:, None] / 30
    home = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0] * 2)
    return (home + 0.15 * ARM * (1 - np.cos(3 * time)) * np.array([1, -1, 1, 1, 1, 1, 0] * 2)).astype(np.float32)


def errors(env: Any, actions: np.ndarray) -> np.ndarray:
    """Distance (T, 14) of the encoders from the actions after each."""
    env.reset(seed=0)
    rows = []
    for action in actions:
        env.step(action)
        rows.append(env.unwrapped.joint_positions() - action)
    return np.array(rows)


def test_the_robot_goes_where_it_is_wanted(rough: str) -> None:
    plainly = errors(make(rough), motion())[:, ARM]
    tracked = errors(CalibratedTracking(make(rough), rough), motion())[:, ARM]
    assert np.sqrt(np.mean(tracked**2)) < np.sqrt(np.mean(plainly**2)) / 4


def test_a_chunk_is_played_with_all_of_it_known(rough: str) -> None:
    """As single actions of which the wrapper was told before; the episode is cut where it was."""
    single, chunked = CalibratedTracking(make(rough), rough), ActionChunk(CalibratedTracking(make(rough), rough), 30)
    single.reset(seed=1)
    chunked.reset(seed=1)
    for part in motion().reshape(2, 30, 14):
        single.preview(part)
        rows = [single.step(action)[0] for action in part]
        seen, *_, info = chunked.step(part)
        assert np.array_equal(seen, rows[-1]) and info["steps"] == 30


@pytest.mark.parametrize("chunk", [1, 4])
def test_a_policy_of_the_reference_sees_its_positions(rough: str, chunk: int) -> None:
    """At the start the rough arms rest in another position than those on which the policy has learnt."""

    def made(robot: str) -> gym.Env:
        return gym.make(ID, robot=robot, image_size=(16, 12), disable_env_checker=True)

    plainly, tracked = made("aloha"), CalibratedTracking(made(rough), rough, reference="aloha")
    plainly, tracked = (env if chunk == 1 else ActionChunk(env, chunk) for env in (plainly, tracked))
    rough_alone = made(rough).reset(seed=0)[0]["agent_pos"]
    seen = [env.reset(seed=0)[0]["agent_pos"] for env in (plainly, tracked)]
    alone, moved = (np.abs(seen[0] - one).max() for one in (rough_alone, tracked.unwrapped.joint_positions()))
    assert np.abs(seen[0] - seen[1]).max() < 3e-3 and moved < alone / 3  # it has moved to where the others rest
    for part in motion(40).reshape(-1, chunk, 14):
        seen = [env.step(part if chunk > 1 else part[0])[0]["agent_pos"] for env in (plainly, tracked)]
    assert np.abs(seen[0] - seen[1])[ARM].max() < 0.02


@pytest.mark.parametrize("chunk", [1, 4])
def test_agent_pos_is_what_the_tracker_says(rough: str, chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Tracker, "observed", lambda self, measured: measured - 0.1)
    inner = gym.make(ID, robot=rough, image_size=(16, 12), disable_env_checker=True)
    tracked: Any = CalibratedTracking(inner, rough, reference="aloha")
    env = tracked if chunk == 1 else ActionChunk(tracked, chunk)
    actions = motion(chunk)
    for play in (lambda: env.reset(seed=0), lambda: env.step(actions if chunk > 1 else actions[0])):
        observation = play()[0]
        expected = env.unwrapped.joint_positions() - 0.1
        np.testing.assert_allclose(observation["agent_pos"][ARM], expected[ARM], atol=1e-6)


def test_observations_of_wrappers_below_are_kept_at_a_reset(rough: str) -> None:
    class Marked(gym.ObservationWrapper):
        def observation(self, observation: Any) -> Any:
            return {**observation, "mark": 1}

    env = gym.make(ID, robot=rough, image_size=(16, 12), disable_env_checker=True)
    tracked = CalibratedTracking(Marked(env), rough, reference="aloha")
    assert tracked.reset(seed=0)[0]["mark"] == tracked.step(motion(1)[0])[0]["mark"] == 1


def test_grippers_get_the_action(rough: str) -> None:
    env = CalibratedTracking(make(rough), rough)
    env.reset(seed=0)
    action = motion(1)[0]
    action[[6, 13]] = 0.25
    assert env.command(action)[[6, 13]].tolist() == [0.25, 0.25]


def test_what_cannot_be_wrapped_is_refused(rough: str) -> None:
    with pytest.raises(SimulationError, match="put ActionChunk around it"):
        CalibratedTracking(ActionChunk(make(rough), 4), rough)
    with pytest.raises(ModelError, match="different joints"):
        CalibratedTracking(make(rough), "so101")
    with pytest.raises(SimulationError, match="encoders of ALOHA"):
        CalibratedTracking(gym.make("Pendulum-v1"), rough)
    env = CalibratedTracking(make(rough), rough)
    env.reset(seed=0)
    with pytest.raises(SimulationError, match="action needs 14 numbers"):
        env.step(np.zeros(3))
