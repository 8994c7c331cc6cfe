"""The environment folder for LeRobot, held to what LeRobot's evaluation reads (lerobot/scripts/lerobot_eval.py)."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.envs import NAMES

FILE = Path(__file__).parents[1] / "examples" / "lerobot" / "env.py"


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module as LeRobot loads it: from its file, unknown to other processes; with small pictures."""
    spec = importlib.util.spec_from_file_location("hub_env_somebody_embodiedreamer", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.ARGUMENTS |= {"image_size": (64, 48), "renderer": "tiny"}
    return module


@pytest.mark.parametrize("use_async_envs", [False, True])
def test_an_evaluation_of_lerobot(hub: ModuleType, use_async_envs: bool) -> None:
    hub.ARGUMENTS["max_episode_steps"] = 3
    made = hub.make_env(n_envs=2, use_async_envs=use_async_envs, cfg=SimpleNamespace(task="PutPenInCup", fps=20))
    assert list(made) == ["embodiedreamer"] and list(made["embodiedreamer"]) == [NAMES.index("PutPenInCup")]
    (env,) = made["embodiedreamer"].values()
    assert isinstance(env, gym.vector.AsyncVectorEnv if use_async_envs else gym.vector.SyncVectorEnv)
    seen, _ = env.reset(seed=[0, 1], options={"lerobot_new_rollout": True})
    assert env.unwrapped.metadata["render_fps"] == 20
    assert env.call("_max_episode_steps")[0] == 3
    for name in ("task_description", "task"):
        assert list(env.call(name)) == ["put the pen into the pen holder"] * 2
    look_at(seen)
    for step in range(3):
        seen, reward, terminated, truncated, info = env.step(np.tile(seen["agent_pos"][:1], (2, 1)))
        look_at(seen)
        assert reward.shape == (2,) and not terminated.any() and truncated.tolist() == [step == 2] * 2
        assert info["is_success"].tolist() == [False] * 2 and ("final_info" in info) == (step == 2)
    assert info["final_info"]["is_success"].tolist() == [False] * 2
    assert info["final_info"]["is_success"].dtype == bool
    assert np.stack(env.call("render")).shape == (2, 480, 640, 3)
    env.close()


def look_at(seen: dict) -> None:
    """As `preprocess_observation` of LeRobot checks it."""
    assert set(seen) == {"pixels", "agent_pos"} and set(seen["pixels"]) == {"head", "left_wrist", "right_wrist"}
    for picture in seen["pixels"].values():
        assert picture.shape == (2, 48, 64, 3) and picture.dtype == np.uint8
    assert seen["agent_pos"].shape == (2, 14) and seen["agent_pos"].dtype == np.float32


def test_one_camera_has_its_name_too(hub: ModuleType) -> None:
    hub.ARGUMENTS["cameras"] = ("head",)
    env = hub.make_env(cfg=SimpleNamespace(task="PutCupOnMat"))["embodiedreamer"][NAMES.index("PutCupOnMat")]
    seen, _ = env.reset(seed=0)
    assert seen["pixels"]["head"].shape == (1, 48, 64, 3) and seen["agent_pos"].shape == (1, 14)
    assert seen in env.observation_space and hasattr(env.envs[0], "task_description")
    env.close()


def test_without_a_configuration_all_tasks_are_made(hub: ModuleType) -> None:
    made = hub.make_env()["embodiedreamer"]
    assert list(made) == list(range(len(NAMES)))
    texts = {env.call("task_description")[0] for env in made.values()}
    assert len(texts) == len(NAMES)
    for env in made.values():
        env.close()


def test_an_unknown_task_is_refused(hub: ModuleType) -> None:
    with pytest.raises(ValueError, match=r"task 'Fly' is not one of .*PutCupOnMat"):
        hub.make_env(cfg=SimpleNamespace(task="Fly"))
