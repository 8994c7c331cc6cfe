"""An episode begins at rest: the arms hang where the command that was heard last holds them against their weight."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.robot import RobotModel
from tests.envs.test_randomize import calibrated

STILL = 1e-3  # rad, or share of the grippers' opening


def test_arms_begin_where_they_stay() -> None:
    env = AlohaEnv(obs_type="state")
    with pytest.raises(gym.error.ResetNeeded):
        env.command  # noqa: B018
    for seed in range(2):
        env.reset(seed=seed)
        start = env.joint_positions()
        np.testing.assert_array_equal(env.command, home(env.robot))
        assert np.abs(start - env.command).max() > 0.05  # of the servos, which are springs
        for _ in range(30):
            env.step(env.command)
        assert np.abs(env.joint_positions() - start).max() < STILL
    env.close()


def test_objects_that_are_placed_do_not_change_how_the_arms_begin() -> None:
    env = AlohaEnv(obs_type="state")
    env.reset(seed=3)
    start, pose = env.joint_positions(), env.object_pose("cup")
    place = np.concatenate([pose.position, pose.quaternion])
    beside = place + np.eye(7)[1] * 0.1
    env.reset(seed=4, options={"object_poses": {"cup": place, "mat": beside}})
    np.testing.assert_array_equal(env.joint_positions(), start)
    env.close()


def test_a_heavier_robot_hangs_lower(tmp_path: Path) -> None:
    model = RobotModel.load("aloha")
    heavy = model.with_effect("payload").with_values({"payload.mass": dict.fromkeys(model.arms, 0.3)})
    heavy.save(tmp_path / "heavy.json")
    ends = []
    for robot in ("aloha", str(tmp_path / "heavy.json")):
        env = AlohaEnv(obs_type="state", robot=robot)
        env.reset(seed=0)
        ends.append(min(env.engine.tip(arm).position[2] for arm in (0, 1)))
        env.close()
    assert ends[1] < ends[0] - 0.005


def test_the_stand_in_begins_alike() -> None:
    pytest.importorskip("mujoco")
    from embodiedreamer_gym.standin.bench import make_stand_in

    real, env = make_stand_in(pictures="none", seed_of_robot=None), AlohaEnv(obs_type="state")
    seen, _ = real.reset(seed=0)
    env.reset(seed=0)
    np.testing.assert_allclose(seen["agent_pos"], env.joint_positions(), atol=5e-3)
    env.close()


def test_arms_that_diverge_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """As those of a model with an effect of the user's own may."""
    env = AlohaEnv(obs_type="state")
    monkeypatch.setattr(env.engine.plant, "observe", lambda: (np.full(14, np.nan), np.zeros(14)))
    with pytest.raises(SimulationError, match="diverge at rest; check its servo gains"):
        env.reset(seed=0)
    env.close()


def test_what_was_drawn_before_does_not_change_how_the_arms_begin(tmp_path: Path) -> None:
    robot, starts = calibrated(tmp_path), []
    for seeds in ((0,), (1, 2, 0)):
        env = AlohaEnv(obs_type="state", robot=robot, randomize="calibration")
        env.reset(seed=9, options={"joint_positions": home(env.robot)} if len(seeds) > 1 else None)
        for seed in seeds:
            env.reset(seed=seed)
        starts.append(env.joint_positions())
        env.close()
    np.testing.assert_array_equal(*starts)
