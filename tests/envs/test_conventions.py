"""What Gymnasium and Stable-Baselines3 ask of an environment, over every id and kind of observation."""

from __future__ import annotations

import pickle  # noqa: TID251  what Gymnasium's vector environments do to an environment
import subprocess
import sys
from collections.abc import Callable, Iterator

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RescaleAction

import embodiedreamer_gym
from embodiedreamer_gym.envs import NAMES
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.wrappers import FlattenCameras
from tests.envs.moves import drain, shove

# Actions are the joint targets that a robot's log holds, rad; RescaleAction is there for those who want [-1, 1].
pytestmark = pytest.mark.filterwarnings("ignore:.*symmetric and normalized")
IDS = [f"EmbodieDreamer/{name}-v0" for name in NAMES]
GOALS = [f"EmbodieDreamer/{name}Goal-v0" for name in NAMES]
THREE = ("head", "left_wrist", "right_wrist")
SMALL = {"image_size": (48, 36), "renderer": "tiny"}
VIEWS = {
    "state": {"obs_type": "state"}, "pixels": {"obs_type": "pixels"}, "pixels_agent_pos": {},
    "pixels of three": {"obs_type": "pixels", "cameras": THREE}, "three": {"cameras": THREE},
}  # fmt: skip
# Every kind of observation of one id, and every id with one: what is observed and what is to be done are independent.
OF_ONE = [pytest.param(IDS[-1], SMALL | view, id=f"{IDS[-1][15:]}-{name}") for name, view in VIEWS.items()]
OF_ONE += [pytest.param(GOALS[-1], SMALL, id=GOALS[-1][15:])]
CASES = OF_ONE + [pytest.param(i, SMALL | VIEWS["state"], id=f"{i[15:]}-state") for i in IDS[:-1]]
CASES += [pytest.param(i, SMALL, id=i[15:]) for i in GOALS[:-1]]
INFO = {
    "is_success": bool, "task_success": bool, "grasp_success": bool, "distance": float, "object_distance": float,
    "remaining": float, "contacts": int, "sim_time": float, "side": str,
}  # fmt: skip
Make = Callable[..., gym.Env]


@pytest.fixture
def make() -> Iterator[Make]:
    """`gym.make` whose environments are closed, twice, at the end."""
    made: list[gym.Env] = []

    def one(*arguments, **keywords) -> gym.Env:
        made.append(gym.make(*arguments, **keywords))
        return made[-1]

    yield one
    for env in (*made, *made):
        env.close()


@pytest.mark.parametrize(("name", "arguments"), CASES)
def test_gymnasium_finds_no_fault(make: Make, name: str, arguments: dict) -> None:
    check_env(make(name, **arguments).unwrapped)


@pytest.mark.parametrize(("name", "arguments"), CASES)
def test_stable_baselines_finds_no_fault(make: Make, name: str, arguments: dict) -> None:
    from stable_baselines3.common.env_checker import check_env as check

    env = make(name, **arguments)
    nested = isinstance(env.observation_space, gym.spaces.Dict) and any(
        isinstance(space, gym.spaces.Dict) for space in env.observation_space.values()
    )
    check(FlattenCameras(env) if nested else env.unwrapped)


@pytest.mark.parametrize(("name", "arguments"), CASES)
def test_all_of_one_kind_are_alike(make: Make, name: str, arguments: dict) -> None:
    """Two new ones, and a new one beside one that has been used."""
    old, other, new = (make(name, **arguments) for _ in range(3))
    check_environments_match(old, other, 2)
    old.reset(seed=3)
    drain(shove(old, np.random.default_rng(3), 30))
    check_environments_match(new, old, 8, seed=1)


def test_pictures_for_people_are_alike_too(make: Make) -> None:
    old, new = (make(IDS[0], obs_type="state", render_mode="rgb_array", renderer="tiny") for _ in range(2))
    old.reset(seed=3)
    drain(shove(old, np.random.default_rng(0), 20))
    check_environments_match(new, old, 2)
    assert new.render().shape == (480, 640, 3)


@pytest.mark.parametrize(("name", "arguments"), OF_ONE)
def test_an_environment_is_made_again_from_its_description(make: Make, name: str, arguments: dict) -> None:
    env = make(name, **arguments)
    seen, info = env.reset(seed=5)
    again = [
        make(env.spec), make(EnvSpec.from_json(env.spec.to_json())), make(pickle.loads(pickle.dumps(env.spec))),
        pickle.loads(pickle.dumps(env)),
    ]  # fmt: skip
    for copy in again:
        assert data_equivalence((seen, info), copy.reset(seed=5), exact=True)
    again[-1].close()


def test_an_id_with_its_module_needs_no_import() -> None:
    code = (
        "import gymnasium as gym; env = gym.make('embodiedreamer_gym:EmbodieDreamer/PutCupOnMat-v0'); "
        "env.reset(seed=0); env.step(env.action_space.sample()); env.close()"
    )
    done = subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("name", [*IDS, *GOALS])
def test_ids_come_with_the_package(name: str) -> None:
    assert embodiedreamer_gym.__version__ and gym.spec(name).max_episode_steps == 300
    assert set(NAMES) == set(TASKS)


# ---- many at once ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("view", "mode", "ends"),
    [
        pytest.param({"obs_type": "state"}, AutoresetMode.NEXT_STEP, [0, 1, 0, 0], id="state-next"),
        pytest.param({"cameras": THREE}, AutoresetMode.SAME_STEP, [0, 1, 0, 1], id="three-same"),
    ],
)
def test_vector_environments(view: dict, mode: AutoresetMode, ends: list[int]) -> None:
    """Episodes of two steps; four steps, of which one is a reset unless resets are part of the last step."""
    seen = {}
    for kind, extra in (("sync", {}), ("async", {"context": "forkserver", "shared_memory": True})):
        options = {"autoreset_mode": mode, **extra}
        env = gym.make_vec(IDS[-1], 2, kind, options, max_episode_steps=2, **SMALL | view)
        env.action_space.seed(0)
        track = [env.reset(seed=[0, 1])]
        track += [env.step(env.action_space.sample()) for _ in range(4)]
        assert env.metadata["render_fps"] == 30 and env.get_attr("task_description") == ("put the cup on the mat",) * 2
        env.close()
        assert [step[3].tolist() for step in track[1:]] == [[bool(end)] * 2 for end in ends]
        finals = ["is_success" in step[4].get("final_info", {}) for step in track[1:]]
        assert finals == [bool(end) and mode is AutoresetMode.SAME_STEP for end in ends]
        seen[kind] = track
    assert data_equivalence(seen["sync"], seen["async"], exact=True)


# ---- what is observed, rewarded and told ------------------------------------------------------------------------


def test_the_defaults(make: Make) -> None:
    env = make(IDS[-1])
    seen, info = env.reset(seed=0)
    assert seen.keys() == {"pixels", "agent_pos"}
    assert (
        seen["pixels"].shape == (96, 128, 3) and seen["pixels"].dtype == np.uint8 and len(np.unique(seen["pixels"])) > 9
    )
    assert seen["agent_pos"].shape == (14,) and seen["agent_pos"].dtype == np.float32
    assert env.metadata["render_fps"] == env.unwrapped.control_hz == 30 and env.metadata["renderer"] == "tiny"
    assert type(env.unwrapped).metadata == {"render_modes": ["rgb_array"], "render_fps": 30}
    assert info["sim_time"] == 0.0 and not info["is_success"]


@pytest.mark.parametrize("name", [IDS[0], GOALS[-1]])
def test_an_episode_is_cut_after_300_steps_and_never_ends_before(make: Make, name: str) -> None:
    env = make(name, obs_type="state")
    env.reset(seed=0)
    hold = env.unwrapped.joint_positions().astype(np.float32)
    ends = [env.step(hold)[2:4] for _ in range(300)]
    assert ends == [(False, False)] * 299 + [(False, True)]


@pytest.mark.parametrize("name", [*IDS, *GOALS])
def test_rewards_and_infos_are_plain_python_and_fresh(make: Make, name: str) -> None:
    env = make(name, obs_type="state", control_hz=20)
    _, info = env.reset(seed=1)
    told = [info]
    for k, (_, reward, terminated, truncated, info) in enumerate(shove(env, np.random.default_rng(1), 12)):
        assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
        assert info["sim_time"] == pytest.approx((k + 1) / 20)
        if "Goal" not in name:
            assert reward == -info["distance"]
        told.append(info)
    assert [{key: type(value) for key, value in info.items()} for info in told] == [INFO] * len(told)
    assert len({id(info) for info in told}) == len(told)


@pytest.mark.parametrize("name", GOALS)
def test_a_goal_environment_rewards_what_it_computes(make: Make, name: str) -> None:
    env = make(name)
    env.reset(seed=2)
    steps = list(shove(env, np.random.default_rng(2), 24))
    achieved, desired = (np.stack([step[0][f"{kind}_goal"] for step in steps]) for kind in ("achieved", "desired"))
    rewards = [step[1] for step in steps]
    compute = env.unwrapped.compute_reward
    assert compute(achieved, desired, [step[4] for step in steps]).tolist() == rewards
    assert [float(compute(a, d, {})) for a, d in zip(achieved, desired, strict=True)] == rewards
    assert rewards == pytest.approx([-step[4]["distance"] for step in steps], abs=1e-12)
    assert len(set(rewards)) == len(rewards)


@pytest.mark.parametrize("name", IDS)
def test_only_goal_environments_compute_rewards(make: Make, name: str) -> None:
    assert not hasattr(make(name, obs_type="state").unwrapped, "compute_reward")


def test_actions_can_be_scaled_to_one(make: Make) -> None:
    inner = make(IDS[0], obs_type="state")
    env = RescaleAction(inner, -1, 1)
    space = inner.action_space
    assert np.isfinite(space.low).all() and np.isfinite(space.high).all() and space.dtype == np.float32
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (14,), np.float32)
    env.reset(seed=0)
    env.step(env.action_space.high)
    np.testing.assert_allclose(inner.unwrapped._command, space.high, rtol=1e-6)


def test_state_names_tell_what_is_what(make: Make) -> None:
    env = make(IDS[0], obs_type="state").unwrapped
    state, _ = env.reset(seed=0)
    named = dict(zip(env.state_names, state, strict=True))
    assert len(named) == 45 and named["side"] == (1.0 if env.side == "left" else -1.0)
    now = env.situation()
    np.testing.assert_allclose([named[f"object.{axis}"] for axis in "xyz"], now.object.position, atol=1e-6)
    np.testing.assert_allclose([named[f"{env.side}_gripper_tip.{axis}"] for axis in "xyz"], now.tip.position, atol=1e-6)
    np.testing.assert_allclose(state[:14], env.joint_positions(), atol=1e-6)


@pytest.mark.parametrize("name", [IDS[0], GOALS[0]])
def test_what_is_pushed_off_the_table_lies_on_the_ground(make: Make, name: str) -> None:
    """Its target follows the cup: without a floor it fell for ever, and the reward with it."""
    env = make(name, obs_type="state")
    env.reset(seed=0)
    env.unwrapped.engine.client.resetBasePositionAndOrientation(
        env.unwrapped.engine.bodies["cup"], (1.2, 0, 0.5), (0, 0, 0, 1)
    )
    hold = env.unwrapped.joint_positions().astype(np.float32)
    for _ in range(60):
        seen, reward, *_ = env.step(hold)
    assert -0.001 < env.unwrapped.object_pose("cup").position[2] < 0.1
    assert -2.0 < reward < -0.5 and seen in env.observation_space


def test_it_prints_nothing(make: Make, capfd: pytest.CaptureFixture[str]) -> None:
    env = make(IDS[0])
    env.reset(seed=0)
    env.close()
    assert capfd.readouterr() == ("", "")
