"""Generated pictures of head and wrist cameras together."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.vis_aligner.bank import Bank, Entry
from embodiedreamer_gym.vis_aligner.bank_files import load_bank, save_bank
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.moving_bench import make_moving_bench
from embodiedreamer_gym.wrappers import ActionChunk, VisAlignerObservationWrapper, VisAlignerVectorWrapper
from tests.wrappers.test_action_chunk import ID

SIZE = (64, 48)
CAMERAS = ("head", "left_wrist", "right_wrist")


def wave(env, count: int) -> np.ndarray:
    """Actions (count, 14) that move both arms from where they are."""
    start = env.unwrapped.joint_positions()
    ramp = np.linspace(0.0, 1.0, count)[:, None]
    towards = np.zeros(14)
    towards[[1, 8]], towards[[2, 9]] = 0.7, -0.5
    return (start + ramp * towards).astype(np.float32)


@pytest.fixture(scope="module")
def bank(tmp_path_factory) -> str:
    """Photos in other colours than the simulator's, by all three cameras."""
    env = gym.make(ID, obs_type="state", disable_env_checker=True).unwrapped
    env.reset(seed=0)
    names, films = tuple(env.segmentation_classes), {name: [] for name in CAMERAS}
    for action in wave(env, 40):
        for name in CAMERAS:
            films[name].append(env.capture(name, SIZE))
        env.step(action)
    head = films["head"][0]
    clips = {name: Condition(**stacked(frames)) for name, frames in films.items()}
    moving = [Episode(name, 255 - clips[name].rgb, clips[name], class_names=names) for name in CAMERAS[1:]]
    entry = Entry(255 - head.rgb, head.segmentation, props=names[3:])
    path = tmp_path_factory.mktemp("bank") / "bank.npz"
    save_bank(Bank(255 - head.rgb, (entry,), None, make_moving_bench(moving)), path)
    env.close()
    return str(path)


def make(bank: str, **options) -> VisAlignerObservationWrapper:
    env = gym.make(ID, obs_type="pixels_agent_pos", image_size=SIZE, disable_env_checker=True)
    return VisAlignerObservationWrapper(env, bank=bank, **({"cameras": CAMERAS} | options))


def test_each_camera_has_a_picture_in_the_observation(bank: str) -> None:
    env = make(bank)
    observation, info = env.reset(seed=0)
    assert env.observation_space.contains(observation) and tuple(observation["pixels"]) == CAMERAS
    assert {name: clip.shape for name, clip in info["frames"].items()} == dict.fromkeys(CAMERAS, (8, 48, 64, 3))
    observation, reward, *_, info = env.step(wave(env, 8))
    assert np.isfinite(reward) and "clips" not in info and info["filmed"] == 8
    for name in CAMERAS:
        assert np.array_equal(observation["pixels"][name], info["frames"][name][-1])
    env.close()


def test_the_wrists_pictures_are_those_of_the_bench_moved_with_the_camera(bank: str) -> None:
    """In inverted colours a picture that is right is nearer to the inverted simulator than the last picture was."""
    env = make(bank)
    env.reset(seed=0)
    before = {name: env.unwrapped.capture(name, SIZE).rgb for name in CAMERAS}
    actions, observation = wave(env, 40), {}
    for chunk in np.split(actions, 5):
        observation, *_ = env.step(chunk)
    for name in CAMERAS[1:]:
        true, made = (
            255 - env.unwrapped.capture(name, SIZE).rgb.astype(float),
            observation["pixels"][name].astype(float),
        )
        copied = np.abs(255 - before[name].astype(float) - true).mean()
        assert copied > 5 and np.abs(made - true).mean() < 0.5 * copied, name
    env.close()


def test_one_wrist_alone_is_one_picture(bank: str) -> None:
    env = make(bank, cameras=("left_wrist",))
    observation, info = env.reset(seed=0)
    assert observation["pixels"].shape == (48, 64, 3) and info["frames"].shape == (8, 48, 64, 3)
    assert env.step(wave(env, 8))[4]["frames"].shape == (8, 48, 64, 3)
    env.close()


def test_an_episode_is_the_same_for_a_seed(bank: str) -> None:
    clips = []
    for _ in range(2):
        env = make(bank)
        env.reset(seed=4)
        clips.append(env.step(wave(env, 8))[4]["frames"])
        env.close()
    assert all(np.array_equal(clips[0][name], clips[1][name]) for name in CAMERAS)


def test_a_chunk_films_with_several_cameras() -> None:
    env = ActionChunk(gym.make(ID, obs_type="state", disable_env_checker=True), 4, CAMERAS[:2], SIZE)
    _, info = env.reset(seed=0)
    assert tuple(info["clips"]) == CAMERAS[:2] and "clip" not in info
    info = env.step(wave(env, 4))[4]
    assert info["clips"]["left_wrist"]["rgb"].shape == (4, 48, 64, 3) and info["filmed"] == 4
    again = ActionChunk(gym.make(ID, obs_type="state", disable_env_checker=True), 4, ("head",), SIZE)
    assert "clip" in again.reset(seed=0)[1]
    with pytest.raises(SimulationError, match="films head and left_wrist at 64 x 48"):
        env.film("head", SIZE)
    env.close()
    again.close()


def test_what_cannot_be_shown_is_said(bank: str, tmp_path) -> None:
    plain = load_bank(bank)
    save_bank(Bank(plain.plate, plain.entries), tmp_path / "head.npz")
    env = make(str(tmp_path / "head.npz"))
    with pytest.raises(VisionError, match="vis bank --moving"):
        env.reset(seed=0)
    env.close()
    with pytest.raises(SimulationError, match="an editor changes the pictures of one camera"):
        make(bank, editor=lambda image, masks, rng, prompt: image)
    with pytest.raises(SimulationError, match="elbow"):
        make(bank, cameras=("head", "elbow")).reset(seed=0)


@pytest.mark.parametrize("cameras", [(), ("head", "head")])
def test_cameras_are_different_names(bank: str, cameras: tuple[str, ...]) -> None:
    with pytest.raises(SimulationError, match="one or more different names"):
        make(bank, cameras=cameras)


def test_one_name_is_one_camera(bank: str) -> None:
    env = make(bank, cameras="left_wrist")
    assert env.cameras == ("left_wrist",) and env.reset(seed=0)[0]["pixels"].shape == (48, 64, 3)
    env.close()


def test_a_vector_of_three_cameras_shows_what_each_alone_shows(bank: str) -> None:
    make_one = lambda: ActionChunk(  # noqa: E731
        gym.make(ID, obs_type="pixels_agent_pos", image_size=SIZE, disable_env_checker=True), 8
    )
    envs = VisAlignerVectorWrapper(gym.vector.SyncVectorEnv([make_one] * 2), bank=bank, cameras=CAMERAS)
    single = make(bank)
    observation, info = envs.reset(seed=[0, 3])
    assert envs.observation_space.contains(observation)
    assert {name: clip.shape for name, clip in info["frames"].items()} == dict.fromkeys(CAMERAS, (2, 8, 48, 64, 3))
    alone, _ = single.reset(seed=3)
    plan = wave(single, 8)
    observation, *_, info = envs.step(np.stack([plan, plan]))
    alone, *_, about = single.step(plan)
    for name in CAMERAS:
        assert np.array_equal(observation["pixels"][name], info["frames"][name][:, -1])
        assert np.abs(info["frames"][name][1].astype(int) - about["frames"][name]).max() <= 1, name
        assert np.abs(observation["pixels"][name][1].astype(int) - alone["pixels"][name]).max() <= 1
    envs.close()
    single.close()
