"""Episodes played: what is executed, what counts as success, what does not fit."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies import evaluate
from embodiedreamer_gym.policies.evaluation import as_batch, executed
from embodiedreamer_gym.wrappers import ActionChunk


class Walk(gym.Env):
    """A point on a line; success while it is far enough."""

    cameras = {"head": None}

    def __init__(self, length: int = 50, beyond: float = 1.05) -> None:
        self.action_space = spaces.Box(-1, 1, (2,), np.float32)
        self.observation_space = spaces.Dict({
            "agent_pos": spaces.Box(-9, 9, (2,), np.float32), "pixels": spaces.Box(0, 255, (4, 4, 3), np.uint8)
        })  # fmt: skip
        self.length, self.beyond = length, beyond

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.steps = 0.0, 0
        return self._seen()

    def step(self, action):
        self.at, self.steps = self.at + float(action[0]), self.steps + 1
        observation, info = self._seen()
        return observation, 0.0, False, self.steps >= self.length, info

    def _seen(self):
        info = {
            "is_success": self.at > self.beyond,
            "grasp_success": self.at > 0.5,
            "object_distance": abs(self.at),
            "side": "left",
        }
        return {"agent_pos": np.array([self.at, 0], np.float32), "pixels": np.zeros((4, 4, 3), np.uint8)}, info


class Goes:
    """Walks on by 0.1, 0.2, ... as the chunk goes."""

    action_size, chunk, cameras = 2, 4, ("head",)

    def __init__(self, sign: float = 1.0) -> None:
        self.sign, self.asked, self.forgot = sign, [], 0

    def __call__(self, batch) -> np.ndarray:
        assert batch["pixels"]["head"].shape == (1, 4, 4, 3)
        self.asked.append(float(batch["agent_pos"][0, 0]))
        chunk = np.zeros((1, 4, 2), np.float32)
        chunk[0, :, 0] = self.sign * np.array([0.1, 0.2, 0.3, 0.4])
        return chunk

    def reset(self) -> None:
        self.forgot += 1


def test_the_first_actions_of_a_chunk_are_executed_then_it_is_asked_again() -> None:
    policy = Goes()
    found = evaluate(policy, Walk(length=6), [3], execute=3)
    np.testing.assert_allclose(policy.asked, [0.0, 0.6], atol=1e-6)
    assert found.execute == 3 and found.episodes[0].steps == 6 and policy.forgot == 1
    assert found.episodes[0].distance == pytest.approx(1.2, abs=1e-6)


def test_success_is_that_of_the_last_step() -> None:
    class Returns(Goes):
        def __call__(self, batch) -> np.ndarray:
            return np.sign(0.5 - batch["agent_pos"][0, 0]) * super().__call__(batch)

    row = evaluate(Returns(), Walk(length=6, beyond=0.95), [0], execute=4).episodes[0]
    assert row.first == 4 and not row.success and row.grasped and row.steps == 6
    row = evaluate(Goes(), Walk(length=8), [0], execute=4).episodes[0]
    assert row.success and row.first == 5 and row.steps == 8 and row.side == "left"


def test_an_episode_is_played_to_its_end() -> None:
    """However long a success has lasted: a policy that cannot rest undoes it."""
    row = evaluate(Goes(), Walk(length=300), [0], execute=4).episodes[0]
    assert row.success and row.first == 5 and row.steps == 300


def test_an_environment_that_takes_chunks_is_given_them() -> None:
    """The same episode as action by action; a success is known at the end of its chunk, and the last chunk may be cut."""
    env, seen = ActionChunk(Walk(length=10), 4), []
    row = evaluate(Goes(), env, [3], watch=lambda seed: lambda observation, info: seen.append(info["steps"])).episodes[
        0
    ]
    alone = evaluate(Goes(), Walk(length=10), [3]).episodes[0]
    assert (row.success, row.grasped, row.distance, row.steps) == (True, True, alone.distance, 10)
    assert (row.first, alone.first) == (5, 5) and seen == [4, 4, 2]
    with pytest.raises(PolicyError, match=r"expects the shape \(4, 2\)"):
        policy = Goes()
        policy.action_size = 14
        evaluate(policy, env, [0])


def test_the_table_and_its_interval() -> None:
    found = evaluate(Goes(), Walk(length=10), range(7, 12))
    assert found.successes == 5 and [e.seed for e in found.episodes] == [7, 8, 9, 10, 11]
    low, high = found.interval
    assert high == 1.0 and low == pytest.approx(0.025 ** (1 / 5))  # Clopper-Pearson for n of n
    assert "success in 5 of 5 episodes of Walk: 100.0% (95 % interval 47.8% .. 100.0%)" in str(found)
    assert len(str(found).splitlines()) == 7
    data = found.as_dict()
    assert data["interval_95"] == [low, high] and data["episodes"][0]["seed"] == 7
    assert evaluate(Goes(-1.0), Walk(length=10), [0]).successes == 0


def test_watchers_see_each_step() -> None:
    seen: dict[int, list[float]] = {}
    rows = []
    found = evaluate(Goes(), Walk(length=5), [1, 2],
                     watch=lambda seed: lambda o, i: seen.setdefault(seed, []).append(float(o["agent_pos"][0])),
                     done=rows.append)  # fmt: skip
    assert {seed: len(values) for seed, values in seen.items()} == {1: 5, 2: 5}
    assert tuple(rows) == found.episodes


def test_how_many_are_executed() -> None:
    policy = Goes()
    assert executed(policy) == 4
    policy.chunk = 100
    assert executed(policy) == 100 and executed(policy, 25) == 25
    for wrong in (0, 101):
        with pytest.raises(PolicyError, match="give 1 to 100"):
            executed(policy, wrong)


def test_a_policy_may_say_that_it_needs_no_camera() -> None:
    policy = Goes()
    expected = evaluate(policy, Walk(), [0])
    policy.cameras = None
    assert evaluate(policy, Walk(), [0]) == expected


def test_what_does_not_fit_is_said() -> None:
    policy = Goes()
    policy.action_size = 14
    with pytest.raises(PolicyError, match="actions have 14 values"):
        evaluate(policy, Walk(), [0])
    policy = Goes()
    policy.cameras = ("wrist",)
    with pytest.raises(PolicyError, match="needs the camera 'wrist', but Walk has head"):
        evaluate(policy, Walk(), [0])
    with pytest.raises(PolicyError, match="at least one episode"):
        evaluate(Goes(), Walk(), [])
    policy = Goes()
    policy.chunk = 5  # says more than it gives
    with pytest.raises(PolicyError, match=r"Goes returned actions of shape \(1, 4, 2\), but \(1, 5, 2\)"):
        evaluate(policy, Walk(), [0])
    policy = Goes(sign=[1, 2, 3])  # type: ignore[arg-type]
    with pytest.raises(PolicyError, match="the policy Goes fails: ValueError: operands"):
        evaluate(policy, Walk(), [0])
    for observation in (np.zeros(3), {"state": np.zeros(3)}):
        with pytest.raises(PolicyError, match="pixels_agent_pos"):
            as_batch(observation, ("head",))


def test_cameras_by_name_stay_as_they_are() -> None:
    pictures = {"a": np.zeros((4, 4, 3), np.uint8), "b": np.ones((4, 4, 3), np.uint8)}
    batch = as_batch({"agent_pos": np.zeros(2), "pixels": pictures}, ("a", "b"))
    assert {name: value.shape for name, value in batch["pixels"].items()} == {"a": (1, 4, 4, 3), "b": (1, 4, 4, 3)}
    assert batch["agent_pos"].dtype == np.float32


def test_chunks_are_judged_action_by_action() -> None:
    """The first success may lie inside a chunk; the results are those of single actions."""
    policy = Goes(-1.0)
    single = evaluate(policy, gym.wrappers.TimeLimit(Walk(), 8), [0, 1], 3)
    chunked = evaluate(policy, ActionChunk(gym.wrappers.TimeLimit(Walk(), 8), 3), [0, 1], 3)
    assert single.episodes == chunked.episodes
