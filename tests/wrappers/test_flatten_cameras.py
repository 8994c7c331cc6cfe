"""Cameras in a flat dictionary, as Stable-Baselines3 takes them."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.wrappers import FlattenCameras

ID = "EmbodieDreamer/PutCupOnMat-v0"
TWO = {"cameras": ("head", "left_wrist"), "image_size": (48, 36), "renderer": "tiny"}


@pytest.fixture
def env():
    made = FlattenCameras(gym.make(ID, **TWO))
    yield made
    made.close()


def test_cameras_become_keys(env: FlattenCameras) -> None:
    assert set(env.observation_space) == {"pixels_head", "pixels_left_wrist", "agent_pos"}
    flat, _ = env.reset(seed=0)
    nested, _ = env.env.reset(seed=0)
    assert flat in env.observation_space
    np.testing.assert_array_equal(flat["pixels_left_wrist"], nested["pixels"]["left_wrist"])
    np.testing.assert_array_equal(flat["pixels_head"], nested["pixels"]["head"])
    np.testing.assert_array_equal(flat["agent_pos"], nested["agent_pos"])
    assert env.step(env.action_space.sample())[0] in env.observation_space


def test_a_description_makes_it_again(env: FlattenCameras) -> None:
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert isinstance(again, FlattenCameras) and again.observation_space == env.observation_space
        again.close()


def test_what_is_flat_stays_as_it_is() -> None:
    for arguments in ({"image_size": (48, 36)}, {**TWO, "obs_type": "pixels"}):
        inner = gym.make(ID, **arguments)
        assert FlattenCameras(inner).observation_space == inner.observation_space
        inner.close()


def test_observations_that_are_no_dictionary_are_refused() -> None:
    inner = gym.make(ID, obs_type="state")
    with pytest.raises(SimulationError, match="needs observations that are dictionaries, not a Box; make the"):
        FlattenCameras(inner)
    inner.close()


def test_stable_baselines_learns_from_it(env: FlattenCameras) -> None:
    from stable_baselines3 import PPO

    model = PPO("MultiInputPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu")
    model.learn(8)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert action in env.action_space
