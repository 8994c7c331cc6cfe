"""Environments of policies: what the robot is sent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from embodiedreamer_gym.pipelines.policy_env import policy_world
from embodiedreamer_gym.wrappers import ActionChunk, CalibratedTracking


def made(positions: bool, **options: Any) -> Any:
    """The environment of a policy whose actions are positions, or commands."""
    policy = SimpleNamespace(action_size=14, chunk=4, cameras=("head",), positions=positions, picture_size=(32, 24))
    env = policy_world(policy, "PutCupOnMat", **options)
    env.close()
    assert isinstance(env, ActionChunk) and env.k == 4
    return env.env


def test_commands_are_sent_as_they_are() -> None:
    assert not isinstance(made(positions=False), CalibratedTracking)


def test_positions_go_through_the_model_of_the_robot() -> None:
    env = made(positions=True)
    assert isinstance(env, CalibratedTracking) and env.tracker.mode == "both" and env.tracker._shadow is None


def test_commands_go_through_a_model_on_request() -> None:
    """The robot is to be where the one that the policy learnt on would be."""
    env = made(positions=False, tracking="aloha", tracking_mode="feed_forward")
    assert isinstance(env, CalibratedTracking) and env.tracker.mode == "feed_forward"
    assert env.tracker._shadow is not None
