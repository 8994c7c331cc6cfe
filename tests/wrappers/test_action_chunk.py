"""A chunk of actions as one action."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.wrappers import ActionChunk

ID = "embodiedreamer_gym:EmbodieDreamer/PutCupOnMat-v0"


def make(**options) -> gym.Env:
    return gym.make(ID, **({"obs_type": "state", "disable_env_checker": True} | options))


def actions(count: int, seed: int = 0) -> np.ndarray:
    """A gentle wander around home (count, 14)."""
    home = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0] * 2)
    return (home + 0.05 * np.random.default_rng(seed).standard_normal((count, 14)).cumsum(axis=0)).astype(np.float32)


def test_a_chunk_is_its_actions_one_after_the_other() -> None:
    """Same observations, rewards and info, to the last bit."""
    single, chunked, plan = make(), ActionChunk(make(), k=4), actions(8)
    single.reset(seed=3)
    chunked.reset(seed=3)
    for part in plan.reshape(2, 4, 14):
        rewards = []
        for action in part:
            observation, reward, *_, info = single.step(action)
            rewards.append(reward)
        seen, total, terminated, truncated, told = chunked.step(part)
        assert np.array_equal(seen, observation) and total == pytest.approx(sum(rewards))
        assert told["rewards"].tolist() == rewards and told["steps"] == 4
        assert told["distance"] == info["distance"] and not terminated and not truncated
    single.close()
    chunked.close()


def test_the_clip_is_what_the_camera_sees_after_each_action() -> None:
    env = ActionChunk(make(), k=3, camera="head", size=(64, 48))
    _, info = env.reset(seed=1)
    assert {k: v.shape for k, v in info["clip"].items()} == {
        "rgb": (3, 48, 64, 3), "classes": (3, 48, 64), "depth": (3, 48, 64), "parts": (3, 48, 64),
        "projections": (3, len(env.unwrapped.engine.part_names), 3, 4),
        "hulls": (len(env.unwrapped.engine.part_names), 48, 3),
    }  # fmt: skip
    assert info["steps"] == 0 and not info["rewards"].any()
    *_, info = env.step(actions(3))
    last = env.unwrapped.capture("head", (64, 48))
    assert len(info["clip"]["rgb"]) == 3
    assert np.array_equal(info["clip"]["rgb"][-1], last.rgb)
    assert np.array_equal(info["clip"]["classes"][-1], last.segmentation)
    assert np.array_equal(info["clip"]["parts"][-1], last.parts) and last.parts.any()
    assert not np.array_equal(info["clip"]["rgb"][0], info["clip"]["rgb"][-1])
    env.close()


def test_a_camera_that_films_less_often_sees_the_same() -> None:
    """After every second action and the last; of a chunk that is cut, after its last too."""
    every, some = (ActionChunk(make(max_episode_steps=8), 5, "head", (64, 48), every=n) for n in (1, 2))
    for env in (every, some):
        assert env.reset(seed=1)[1]["filmed"] == 0
    plan = actions(10)
    for part, seen in ((plan[:5], [1, 3, 4]), (plan[5:], [1, 2])):
        (*_, whole), (*_, few) = every.step(part), some.step(part)
        assert few["filmed"] == len(seen) and whole["filmed"] == few["steps"] == whole["steps"]
        assert few["clip"]["rgb"].shape == (3, 48, 64, 3)
        for key, values in few["clip"].items():
            if key == "hulls":
                continue
            assert np.array_equal(values[: len(seen)], whole["clip"][key][seen])
            assert np.array_equal(values[-1], whole["clip"][key][-1]), "what is not there repeats the last"
    for env in (every, some):
        env.close()


def test_an_episode_that_is_cut_ends_the_chunk() -> None:
    env = ActionChunk(make(max_episode_steps=6), k=4)
    env.reset(seed=0)
    assert env.step(actions(4))[3] is False
    *_, truncated, info = env.step(actions(4))
    assert truncated and info["steps"] == 2
    assert (info["rewards"] != 0).tolist() == [True, True, False, False]
    env.close()


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
def test_gymnasium_is_content() -> None:
    env = ActionChunk(make(), k=2)
    check_env(env, skip_render_check=True)
    assert env.spec is not None and env.spec.additional_wrappers[-1].kwargs == {
        "k": 2,
        "camera": None,
        "size": None,
        "every": 1,
    }
    env.close()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"k": 0}, "not 0"),
        ({"k": True}, "not True"),
        ({"k": 2.5}, "not 2.5"),
        ({"every": 0}, "every n = 1 or more, not 0"),
        ({"k": (value for value in "ab")}, "not <generator"),  # cannot be copied
    ],
)
def test_bad_chunks_are_refused(options, says) -> None:
    env = make()
    with pytest.raises(SimulationError, match=says):
        ActionChunk(env, **options)
    with pytest.raises(SimulationError, match="no method capture"):
        ActionChunk(gym.make("Pendulum-v1"), camera="head")
    with pytest.raises(SimulationError, match="arrays, not a Discrete"):
        ActionChunk(gym.make("CartPole-v1"))
    chunked = ActionChunk(env, k=3)
    chunked.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(3, 14\), not shape \(2, 14\)"):
        chunked.step(actions(2))
    for wrong in (None, [[0.0], [0.0] * 14], object()):
        with pytest.raises(SimulationError, match="a chunk needs 42 real numbers"):
            chunked.step(wrong)
    env.close()


def drawn(env: gym.Env, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that grows with each picture that the environment draws for an observation."""
    world, pictures = env.unwrapped, []
    draw = world.engine.rgb
    monkeypatch.setattr(world.engine, "rgb", lambda *given: (pictures.append(1), draw(*given))[1])
    return pictures


def test_only_the_picture_that_is_shown_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """And it is the right one, where the chunk ends as where the episode is cut in its middle."""
    options = {"obs_type": "pixels_agent_pos", "image_size": (32, 24), "max_episode_steps": 6}
    single, plan = make(**options), actions(8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of Gymnasium's checker too
        chunked = ActionChunk(make(**options, disable_env_checker=False), k=4)
        single.reset(seed=3)
        chunked.reset(seed=3)
        chunked.step(plan[:4])
    chunked.reset(seed=3)
    pictures = drawn(chunked, monkeypatch)
    for part in plan.reshape(2, 4, 14):
        for action in part:
            observation, *_, truncated, _ = single.step(action)
            if truncated:
                break
        seen, *_, cut, _ = chunked.step(part)
        assert np.array_equal(seen["pixels"], observation["pixels"]) and cut == truncated
        assert np.array_equal(seen["agent_pos"], observation["agent_pos"])
    assert cut and len(pictures) == 2
    single.close()
    chunked.close()


def test_a_wrapper_that_looks_at_observations_sees_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    inner = make(obs_type="pixels", image_size=(32, 24))
    env = ActionChunk(gym.wrappers.FrameStackObservation(inner, 3), k=4)
    env.reset(seed=3)
    pictures = drawn(env, monkeypatch)
    seen = env.step(actions(4) + np.linspace(0.0, 0.3, 4, dtype=np.float32)[:, None])[0]
    assert len(pictures) == 4 and not np.array_equal(seen[0], seen[1])
    env.close()
