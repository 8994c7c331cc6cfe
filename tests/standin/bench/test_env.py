"""The stand-in's bench as an environment: an open-loop expert succeeds there, and a robot with other physics fails."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import MissingExtraError, SimulationError, VisionError
from embodiedreamer_gym.standin.bench import make_stand_in, pictures
from embodiedreamer_gym.wrappers import ActionChunk
from tests.standin.bench.played import SEED, STEPS
from tests.standin.film.grey import needs_bpy

CROOKED = {
    "encoder_offset": {"angle": [0.15, *[0.0] * 6] * 2},
    "stribeck_friction": {"sliding": 0.01, "extra_static": 0.02, "speed": 0.1},
}


ON = [0.74, 0.0, 0.0, 0.0, 1.0]  # height of the table, upright


def replay(env: ActionChunk, actions: np.ndarray, seed: int = SEED) -> tuple[Any, dict[str, Any]]:
    """Observation and info after all actions."""
    env.reset(seed=seed)
    observation, info = None, {}
    for i in range(0, len(actions), env.k):
        observation, *_, info = env.step(actions[i : i + env.k])
    return observation, info


@pytest.mark.parametrize("task", TASKS)
def test_props_stand_where_aloha_puts_them(task: str) -> None:
    """Of the first episode of a seed, and of the one after it."""
    ours, theirs = make_stand_in(task, pictures="none"), AlohaEnv(task, obs_type="state", renderer="tiny")
    for seed in (7, None):
        (_, told), (_, info) = ours.reset(seed=seed), theirs.reset(seed=seed)
        now, wanted = ours.unwrapped.situation(), theirs.situation()
        assert now.side == wanted.side == told["side"]
        for found, there in ((now.object, wanted.object), (now.goal, wanted.goal)):
            np.testing.assert_allclose(found.position, there.position, atol=1e-9)
            np.testing.assert_allclose(found.rotation, there.rotation, atol=1e-9)
        np.testing.assert_allclose(now.base, wanted.base)
        assert set(told) == {*info, "steps", "rewards", "successes"} and not told["grasp_success"]
        assert told["remaining"] == pytest.approx(info["remaining"], abs=0.02)
    theirs.close()


def test_what_the_expert_did_in_aloha_succeeds_here(bench: ActionChunk, shown: np.ndarray) -> None:
    _, info = replay(bench, shown)
    assert info["is_success"] and info["task_success"] and info["grasp_success"]
    assert info["contacts"] == 0 and info["object_distance"] < 0.02 and info["remaining"] == 0.0
    assert info["sim_time"] == pytest.approx(STEPS / 30) and info["steps"] == 10


def test_another_robot_fails_with_the_same_actions_as_often_as_it_tries(bench: ActionChunk, shown: np.ndarray) -> None:
    """Its waists stand aside, which its encoders do not tell; the episode is the same again, whatever went before."""
    fine, _ = replay(bench, shown)
    env = make_stand_in("PutCupOnMat", CROOKED, chunk=10, pictures="none")
    first, info = replay(env, shown)
    assert not info["is_success"]
    assert 1e-3 < np.abs(first["agent_pos"] - fine["agent_pos"]).max() < 0.1
    replay(env, shown[:50], seed=9)
    again, told = replay(env, shown)
    np.testing.assert_array_equal(first["agent_pos"], again["agent_pos"])
    np.testing.assert_equal(told, info)


def test_robots_of_other_seeds_differ_a_little_and_those_of_one_do_not(bench: ActionChunk) -> None:
    seen = [env.reset(seed=0)[0]["agent_pos"] for env in (
        bench, make_stand_in(pictures="none"), make_stand_in(pictures="none", seed_of_robot=1),
        make_stand_in(pictures="none", seed_of_robot=None))]  # fmt: skip
    np.testing.assert_array_equal(seen[0], seen[1])
    assert all(1e-4 < np.abs(one - seen[0]).max() < 0.05 for one in seen[2:])


def test_the_arms_rest_at_the_start(bench: ActionChunk) -> None:
    before, _ = bench.reset(seed=3)
    rest = home(bench.unwrapped.robot)
    after = before
    for _ in range(3):
        after, *_ = bench.step(np.tile(rest, (10, 1)))
    np.testing.assert_allclose(after["agent_pos"], before["agent_pos"], atol=1e-4)
    assert bench.observation_space.contains(after)


def test_a_delay_and_an_offset_are_heard_by_the_encoders(bench: ActionChunk) -> None:
    rest = home(bench.unwrapped.robot)
    late = make_stand_in(
        chunk=10,
        pictures="none",
        effects={"command_delay": {"seconds": 0.1}, "encoder_offset": {"angle": [0.05] + [0.0] * 13}},
    )
    moved = np.tile(rest, (10, 1))
    moved[7:] += 0.05
    seen = []
    for env in (bench, late):
        start, _ = env.reset(seed=0)
        seen.append(env.step(moved)[0]["agent_pos"] - start["agent_pos"])
    assert np.abs(seen[1]).max() < 1e-5 < 0.005 < np.abs(seen[0]).max()
    assert start["agent_pos"][0] == pytest.approx(0.0, abs=5e-3)  # it stands 0.05 beside, and says it does not


def test_a_camera_is_closed_with_the_world() -> None:
    class Camera:
        closed = 0

        def __call__(self, poses: Mapping[str, np.ndarray]) -> np.ndarray:
            return np.zeros((96, 128, 3), np.uint8)

        def close(self) -> None:
            self.closed += 1

    camera = Camera()
    make_stand_in(pictures=camera).close()
    assert camera.closed >= 1
    make_stand_in(pictures=lambda poses: np.zeros((96, 128, 3), np.uint8)).close()


def test_pictures_are_taken_once_a_step_of_where_things_are(shown: np.ndarray) -> None:
    taken: list[Mapping[str, np.ndarray]] = []

    def camera(poses: Mapping[str, np.ndarray]) -> np.ndarray:
        taken.append(poses)
        return np.full((96, 128, 3), len(taken), np.uint8)

    env = make_stand_in(pictures=camera, chunk=40)
    observation, _ = env.reset(seed=SEED)
    cup = env.unwrapped.situation().object
    assert len(taken) == 1 and (observation["pixels"] == 1).all()
    np.testing.assert_allclose(taken[0]["cup"][:3, 3], cup.position)
    np.testing.assert_allclose(taken[0]["cup"][:3, :3], cup.rotation, atol=1e-9)
    observation, *_ = env.step(shown[:40])
    assert len(taken) == 2 and (observation["pixels"] == 2).all()
    assert (
        np.abs(taken[1]["left_link6"] - taken[0]["left_link6"]).max() > 0.05
        or env.unwrapped.situation().side == "right"
    )


def test_an_episode_is_cut_after_300_steps() -> None:
    env = make_stand_in(pictures="none", chunk=80)
    env.reset(seed=0)
    still = np.tile(home(env.unwrapped.robot), (80, 1))
    steps = [env.step(still)[2:] for _ in range(4)]
    assert [truncated for _, truncated, _ in steps] == [False, False, False, True]
    assert [info["steps"] for *_, info in steps] == [80, 80, 80, 60]


def test_a_prop_can_be_placed(bench: ActionChunk) -> None:
    where = [0.5, -0.2, 0.74, 0.0, 0.0, 0.0, 1.0]
    _, info = bench.reset(seed=0, options={"object_poses": {"cup": where}})
    np.testing.assert_allclose(bench.unwrapped.situation().object.position, where[:3])
    assert info["side"] == "right"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"task": "PutCup"}, "there is no task 'PutCup'; give one of GrabPaperCup"),
        ({"chunk": 0}, "a chunk has k = 1 or more actions, not 0"),
        ({"control_hz": 25}, "control_hz 25 is not one of 50, 40, 30, 20"),
        ({"size": (4, 4)}, "is not a width and height from 8 to 4096"),
        ({"pictures": "painted"}, "pictures 'painted' is not one of 'traced', 'none'"),
        ({"effects": {"rust": {}}}, "the stand-in has no effect 'rust'"),
    ],
)
def test_a_mistake_is_one_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make_stand_in(**{"pictures": "none", **arguments})


def test_what_comes_before_a_reset_or_begins_elsewhere_is_refused() -> None:
    env = make_stand_in(pictures=lambda poses: np.zeros((2, 2, 3), np.uint8), chunk=1)
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros((1, 14)))
    with pytest.raises(SimulationError, match="starts at rest at its first command"):
        env.reset(seed=0, options={"joint_positions": home(env.unwrapped.robot) + 0.01})
    with pytest.raises(
        SimulationError, match=r"pictures must return uint8 of shape \(96, 128, 3\), not uint8 of \(2, 2, 3\)"
    ):
        env.reset(seed=0)
    with pytest.raises(SimulationError, match="pictures without depth and classes"):
        env.unwrapped.capture()


def test_without_an_extra_the_line_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(blender: str | None) -> None:
        raise MissingExtraError("the path-traced camera needs Blender's module bpy; run: pip install bpy")

    monkeypatch.setattr(pictures, "find_blender", absent)
    with pytest.raises(MissingExtraError, match="run: pip install"):
        make_stand_in()


def test_the_old_name_works_with_a_warning() -> None:
    from embodiedreamer_gym.standin import bench

    with pytest.warns(DeprecationWarning, match="make_stand_in"):
        assert bench.StandInEnv is make_stand_in


# ---- with Blender --------------------------------------------------------------------------------------------------


@pytest.fixture
def filmed(monkeypatch: pytest.MonkeyPatch) -> Iterator[ActionChunk]:
    monkeypatch.setattr(pictures, "SAMPLES", 1)
    env = make_stand_in("PutCupOnMat", size=(48, 36))
    yield env
    env.close()
    env.close()


@needs_bpy
def test_the_camera_sees_the_cup_and_not_twice_the_same_noise(filmed: ActionChunk) -> None:
    here = {"mat": [0.6, 0.0, *ON], "cup": [0.5, 0.2, *ON]}
    there = {**here, "cup": [0.5, -0.2, *ON]}
    first = filmed.reset(seed=0, options={"object_poses": here})[0]["pixels"].astype(int)
    again = filmed.reset(options={"object_poses": here})[0]["pixels"].astype(int)
    moved = filmed.reset(seed=0, options={"object_poses": there})[0]["pixels"].astype(int)
    assert first.shape == (36, 48, 3) and 60 < np.median(first) < 200
    assert 0.5 < np.abs(first - again).mean() < 4.0
    assert np.abs(first - moved).max() > 40 > np.abs(first - again).max()


def test_an_appearance_of_each_episode_is_refused() -> None:
    with pytest.raises(VisionError, match="a bench has one appearance"):
        make_stand_in(appearance="many")
    with (
        pytest.warns(DeprecationWarning, match="'look' of make_stand_in is now 'appearance'"),
        pytest.raises(VisionError),
    ):
        make_stand_in(look="many")
