"""Rollouts: tries from one start, exploration, vectors, what is kept, and what is refused."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from embodiedreamer_gym.errors import PolicyError, SimulationError
from embodiedreamer_gym.policies.preferences import load_trajectories
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.preference_rollout import (
    PreferenceRolloutVectorWrapper,
    PreferenceRolloutWrapper,
    policy_batch,
)

K = 3


class Walk(gym.Env):
    """A point that goes where its action says; each start has a target, a grey picture, and 4 to 10 steps."""

    def __init__(self, told: bool = True, picture: bool = True, ends: bool = True) -> None:
        self.told, self.picture, self.ends = told, picture, ends
        self.action_space = spaces.Box(-1, 1, (2,), np.float32)
        place = spaces.Box(-50, 50, (4,), np.float64)
        pixels = spaces.Box(0, 255, (4, 5, 3), np.uint8)
        self.observation_space = spaces.Dict({"agent_pos": place, "pixels": pixels}) if picture else place

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.target, self.steps = np.zeros(2), self.np_random.uniform(-1, 1, 2), 0
        self.length = int(self.np_random.integers(4, 11))
        return self._seen(), self._info()

    def step(self, action):
        self.at, self.steps = self.at + action, self.steps + 1
        return self._seen(), 0.0, False, self.ends and self.steps >= self.length, self._info()

    def _info(self):
        distance = float(np.linalg.norm(self.at - self.target))
        return {"distance": distance, "is_success": distance < 0.5, "other": "text"} if self.told else {}

    def _seen(self):
        place = np.concatenate([self.at, self.target])
        return {"agent_pos": place, "pixels": np.full((4, 5, 3), self.steps, np.uint8)} if self.picture else place


class Half:
    """Says chunks of four actions, half of the way to the target; a normalised unit is 0.2."""

    network, action_size, chunk = None, 2, 4

    def __init__(self, size: int = 2, chunk: int = 4) -> None:
        self.size, self.length, self.asked = size, chunk, []

    def __call__(self, batch):
        self.asked.append(batch)
        way = 0.2 * (batch["agent_pos"][:, 2:] - batch["agent_pos"][:, :2])
        return np.repeat(np.tile(way, (1, self.size))[:, None, : self.size], self.length, axis=1)


SPREAD = np.array([0.2, 0.2])


def wrapped(count: int = 0, mode: AutoresetMode = AutoresetMode.NEXT_STEP, **options):
    if not count:
        return PreferenceRolloutWrapper(ActionChunk(Walk(), K), **options)
    envs = SyncVectorEnv([lambda: ActionChunk(Walk(), K) for _ in range(count)], autoreset_mode=mode)
    return PreferenceRolloutVectorWrapper(envs, **options)


def test_what_is_kept_is_what_was_seen_and_done() -> None:
    (one,) = wrapped(tries=1, noise=0.0).rollouts(Half(), [5], SPREAD)
    env = Walk()
    env.reset(seed=5)
    assert one.counts.tolist() == [3, 3, env.length - 6] and one.actions.shape == (3, K, 2)
    for chunk, count in enumerate(one.counts):
        assert one.observations["agent_pos"][chunk] == pytest.approx(np.concatenate([env.at, env.target]), abs=1e-6)
        assert (one.observations["pixels/head"][chunk] == env.steps).all()
        for action in one.actions[chunk, :count]:
            info = env.step(action)[4]
    assert one.outcome == pytest.approx({k: float(info[k]) for k in ("distance", "is_success")}, abs=1e-6)
    assert one.observations["agent_pos"].dtype == np.float32 and one.observations["pixels/head"].dtype == np.uint8
    assert np.array_equal(one.actions, one.means) and one.seed == 5


@pytest.mark.parametrize(("per", "offsets"), [("chunk", 1), ("step", K)])
def test_exploration_is_of_the_size_and_kind_asked_for(per: str, offsets: int) -> None:
    found = list(wrapped(tries=40, noise=0.5, per=per).rollouts(Half(), [5], SPREAD))
    noise = np.concatenate([(one.actions - one.means)[:2] for one in found])
    assert [one.attempt for one in found] == list(range(40))
    assert len(np.unique(noise[0, :, 0].round(6))) == offsets
    assert noise.std() == pytest.approx(0.5 * 0.2, rel=0.2)
    assert all(np.array_equal(one.observations["agent_pos"][0], found[0].observations["agent_pos"][0]) for one in found)
    assert len({one.outcome["distance"] for one in found}) == 40


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("count", [2, 5])
def test_a_vector_plays_what_one_environment_plays(count: int, mode: AutoresetMode) -> None:
    """Also with episodes of different lengths, and more environments than there is work for at the end."""
    seeds = [5, 5 + 2**33, 11] if mode is not AutoresetMode.DISABLED else [5, 5, 5]
    alone = list(wrapped(tries=3, noise=0.5).rollouts(Half(), seeds, SPREAD))
    both = list(wrapped(count, mode, tries=3, noise=0.5).rollouts(Half(), seeds, SPREAD))
    assert len(alone) == len(both) == 9
    for one, other in zip(alone, both, strict=True):
        assert (one.seed, one.attempt) == (other.seed, other.attempt)
        assert np.allclose(one.actions, other.actions, atol=1e-6) and one.counts.tolist() == other.counts.tolist()
        assert one.outcome == pytest.approx(other.outcome, abs=1e-6)


def test_without_autoreset_episodes_end_together() -> None:
    with pytest.raises(SimulationError, match="autoreset_mode DISABLED; use another"):
        list(wrapped(2, AutoresetMode.DISABLED, tries=1).rollouts(Half(), [5, 6], SPREAD))


def test_the_environment_gets_actions_of_its_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what was drawn is kept, whose likelihood is that of a Gaussian."""
    played, step = [], Walk.step
    monkeypatch.setattr(Walk, "step", lambda self, action: (played.append(action), step(self, action))[1])
    (one,) = wrapped(tries=1, noise=20.0).rollouts(Half(), [1], SPREAD)
    assert np.abs(played).max() == 1.0 and np.abs(one.actions).max() > 2.0
    assert np.array_equal(np.clip(one.actions[one.played], -1, 1), played)
    assert np.array_equal(next(wrapped(tries=1, noise=20.0).rollouts(Half(), [1], SPREAD)).actions, one.actions)


def test_a_fixed_number_of_chunks() -> None:
    (one,) = wrapped(tries=1, chunks=2).rollouts(Half(), [5], SPREAD)
    assert len(one) == 2 and one.counts.tolist() == [3, 3]


def test_the_policys_own_unit_is_taken() -> None:
    policy, network = Half(), type("Net", (), {})()
    network.denormalise = lambda a: 0.4 * a + 3.0
    network.parameters = lambda: iter(())
    policy.network = network
    narrow = next(wrapped(tries=1, noise=0.1).rollouts(policy, [5], SPREAD))
    wide = next(wrapped(tries=1, noise=0.1).rollouts(policy, [5]))
    assert (wide.actions - wide.means)[0] == pytest.approx(2 * (narrow.actions - narrow.means)[0], abs=1e-6)


def test_files_of_starts_are_kept(tmp_path: Path) -> None:
    env, policy, told = wrapped(tries=2), Half(), []
    (tmp_path / ".start-00000006.hdf5.part").touch()
    files = env.record(policy, [5, 6], tmp_path, SPREAD, lambda *said, **more: told.append((*said, more)))
    assert [path.name for path in files] == ["start-00000005.hdf5", "start-00000006.hdf5"]
    assert [said[:3] for said in told] == [("rollouts", n, 4) for n in (1, 2, 3, 4)] and "distance" in told[0][3]
    files[1].unlink()
    stamp, asked = files[0].stat().st_mtime_ns, len(policy.asked)
    assert env.record(policy, [5, 6], tmp_path, SPREAD) == files
    assert files[0].stat().st_mtime_ns == stamp and (asked, len(policy.asked)) == (14, 22)
    found = load_trajectories(files[1])[0]
    assert [(one.seed, one.attempt) for one in found] == [(6, 0), (6, 1)]


def test_the_wrapper_is_one() -> None:
    env = PreferenceRolloutWrapper(Walk(), tries=2, noise=0.3, per="step", chunk=4, chunks=5, camera="wrist")
    assert env.action_space.shape == (4, 2) and isinstance(env.env, ActionChunk)
    assert env.reset(seed=1)[0]["agent_pos"].shape == (4,) and len(env.step(np.zeros((4, 2)))) == 5
    kwargs = {"tries": 2, "noise": 0.3, "per": "step", "chunk": 4, "chunks": 5, "camera": "wrist"}
    assert env._saved_kwargs == kwargs
    assert PreferenceRolloutWrapper(Walk(), **kwargs).per == "step"


def test_observations_as_policies_take_them() -> None:
    state, picture = np.zeros((2, 3)), np.zeros((2, 4, 5, 3), np.uint8)
    assert policy_batch(state)["agent_pos"].dtype == np.float32
    assert policy_batch(picture, "wrist")["pixels"]["wrist"] is picture
    several = {"agent_pos": state, "pixels": {"a": picture, "b": picture}}
    assert list(policy_batch(several)["pixels"]) == ["a", "b"]
    plain = PreferenceRolloutWrapper(Walk(picture=False), tries=1, chunk=K)
    assert list(next(plain.rollouts(Half(), [5], SPREAD)).observations) == ["agent_pos"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tries": 0}, "at least 1 try"),
        ({"chunks": 0}, "1 chunk"),
        ({"noise": -0.1}, "noise is -0.1"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"per": "episode"}, "'episode' is not one of chunk, step"),
    ],
)
def test_options_are_checked(options, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        wrapped(**options)


def test_what_cannot_be_rolled_out_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SimulationError, match="wrap it in ActionChunk"):
        PreferenceRolloutWrapper(Walk())
    with pytest.raises(SimulationError, match="wrap it in ActionChunk"):
        PreferenceRolloutVectorWrapper(SyncVectorEnv([Walk]))
    with pytest.raises(SimulationError, match="info has no outcome of the episode"):
        list(PreferenceRolloutWrapper(Walk(told=False), chunk=K).rollouts(Half(), [1], SPREAD))
    monkeypatch.setattr("embodiedreamer_gym.wrappers.preference_rollout.MOST_CHUNKS", 20)
    with pytest.raises(SimulationError, match="not over after 20 chunks"):
        list(PreferenceRolloutWrapper(Walk(ends=False), chunk=K).rollouts(Half(), [1], SPREAD))
    for policy in (Half(size=3), Half(chunk=2)):
        with pytest.raises(PolicyError, match=r"but \(1, 3, 2\) or a longer"):
            list(wrapped().rollouts(policy, [1], SPREAD))
