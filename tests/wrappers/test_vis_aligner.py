"""Generated pictures around an environment: physics untouched, the references passed on."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.vis_aligner.bank import Bank, Entry
from embodiedreamer_gym.vis_aligner.bank_files import load_bank, save_bank
from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.wrappers import ActionChunk, VisAlignerObservationWrapper, VisAlignerVectorWrapper
from tests.wrappers.test_action_chunk import ID, actions

SIZE = (64, 48)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, str]:
    """A small untrained aligner, and a bank of two photos: the simulator's own pictures in other colours."""
    folder = tmp_path_factory.mktemp("vis")
    torch.manual_seed(0)
    network = Lean(LeanConfig((8, 8, 8, 16)))
    torch.nn.init.normal_(network.out.weight, std=0.1)
    save_aligner(LeanAligner(network, chunk=3), folder)
    env = gym.make(ID, obs_type="state", disable_env_checker=True).unwrapped
    entries = []
    for seed in range(2):
        env.reset(seed=seed)
        view = env.capture("head", SIZE)
        poses = {name: np.concatenate([env.object_pose(name).position, env.object_pose(name).quaternion])
                 for name in env.engine.bodies}  # fmt: skip
        entries.append(Entry(255 - view.rgb, view.segmentation, env.joint_positions(), poses))
    env.close()
    save_bank(Bank(entries[0].frame, tuple(entries)), folder / "bank.npz")
    return {"aligner": str(folder / "lean.pt"), "bank": str(folder / "bank.npz")}


def make(files: dict[str, str], **options) -> gym.Env:
    wrapped = {k: options.pop(k) for k in ("chunk", "every") if k in options}
    env = gym.make(ID, **({"image_size": SIZE, "disable_env_checker": True} | options))
    return VisAlignerObservationWrapper(env, **files, **wrapped)


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
@pytest.mark.parametrize("obs_type", ["pixels", "pixels_agent_pos"])
def test_gymnasium_is_content(files, obs_type: str) -> None:
    env = make(files, obs_type=obs_type)
    check_env(env, skip_render_check=True)
    assert env.action_space.shape == (3, 14)
    env.close()


def test_benches_can_be_edited(files) -> None:
    """The first frame, the plate and what is generated from them; another seed draws another edit."""

    def tinted(image, masks, rng, prompt):
        level = int(rng.integers(1, 255))
        return np.where(masks["table"][..., None], level, image).astype(np.uint8)

    plain = make(files)
    env = VisAlignerObservationWrapper(plain.env, **files, editor=tinted)
    shown = {seed: env.reset(seed=seed)[0]["pixels"] for seed in (1, 1, 2)}
    untouched = plain.reset(seed=1)[0]["pixels"]
    again = env.reset(seed=1)[0]["pixels"]
    table = env.references.last_condition.classes[0] == 1
    level = np.unique(again[table])
    assert len(level) == 1 and level != np.unique(untouched[table])[0]
    assert np.array_equal(again, shown[1]) and np.array_equal(again[~table], untouched[~table])
    assert (shown[2] != shown[1]).any()
    plain.close()


def test_a_long_chunk_is_dreamed_in_pieces(files) -> None:
    """Seven actions at once show what three, three and one show: the aligner is never asked for more than it learnt."""
    long, short, played = make(files, chunk=7), make(files, chunk=1), actions(7)
    long.reset(seed=5)
    short.reset(seed=5)
    seen, *_, info = long.step(played)
    views = [short.env.step(one[None])[4]["clip"] for one in played]
    whole = Condition.joined([Condition(**view) for view in views])
    references, frames = short.references, []
    for start in (0, 3, 6):
        part = whole.part(start, start + 3)
        frames.append(short.aligner.render([references], [part])[0])
        references = references.after(frames[-1], part)
    assert np.array_equal(info["frames"], np.concatenate(frames))
    assert np.array_equal(seen["pixels"], frames[-1][-1])
    long.close()
    short.close()


def test_frames_between_which_nobody_looks_are_not_dreamed(files) -> None:
    """After every second of seven actions and the last: what the aligner makes of these four instants."""
    few, every, played = make(files, chunk=7, every=2), make(files, chunk=7), actions(7)
    few.reset(seed=5)
    every.reset(seed=5)
    seen, *_, info = few.step(played)
    instants = Condition(**every.env.step(played)[4]["clip"]).at([1, 3, 5, 6])
    references, frames = every.references, []
    for start in (0, 3):
        part = instants.part(start, start + 3)
        frames.append(every.aligner.render([references], [part])[0])
        references = references.after(frames[-1], part)
    assert info["filmed"] == 4 and info["steps"] == 7
    assert np.array_equal(info["frames"], np.concatenate(frames)) and np.array_equal(seen["pixels"], frames[-1][-1])
    few.close()
    every.close()


def test_physics_and_reward_are_untouched(files) -> None:
    env, plain = make(files), ActionChunk(gym.make(ID, obs_type="state", disable_env_checker=True), k=3)
    env.reset(seed=5)
    plain.reset(seed=5)
    for part in actions(6).reshape(2, 3, 14):
        observation, reward, *_, info = env.step(part)
        _, expected, *_, told = plain.step(part)
        assert reward == expected and info["distance"] == told["distance"]
        assert info["frames"].shape == (3, 48, 64, 3) and "clip" not in info
        assert np.array_equal(observation["pixels"], info["frames"][-1])
    env.close()
    plain.close()


def test_the_last_frame_is_the_next_reference_and_the_anchor_stays(files) -> None:
    env = make(files)
    observation, info = env.reset(seed=5)
    first = observation["pixels"]
    assert (info["frames"] == first).all() and np.array_equal(env.references.last, first)
    seen = env.step(actions(3))[0]["pixels"]
    assert np.array_equal(env.references.last, seen) and np.array_equal(env.references.anchor, first)
    again = env.reset(seed=5)[0]["pixels"]
    assert np.array_equal(again, first)
    env.close()


def test_a_photo_sets_the_simulator(files) -> None:
    """Its joints and objects: the scene that the photo shows."""
    env = make(files)
    observation, _ = env.reset(seed=9, options={"reference": 1})
    entry = env.bank.entry(1)
    assert np.array_equal(observation["pixels"], entry.frame)
    assert env.unwrapped.joint_positions() == pytest.approx(entry.joints, abs=1e-6)
    assert (env.references.last_condition.classes[0] == entry.classes).mean() > 0.999
    with pytest.raises(VisionError, match=r"0 \.\. 1, not 2"):
        env.reset(options={"reference": 2})
    env.close()


def test_it_can_be_made_by_its_spec_and_drawn(files) -> None:
    env = make(files, render_mode="rgb_array")
    kwargs = env.spec.additional_wrappers[-1].kwargs
    assert kwargs == {**files, "chunk": None, "editor": None, "every": 1, "grain": False, "device": "cpu", "cameras": ("head",),
                      "moving_aligner": "assembled"}  # fmt: skip
    env.reset(seed=0)
    assert np.array_equal(env.render(), env.references.last)
    again = gym.make(env.spec)
    assert isinstance(again, VisAlignerObservationWrapper)
    env.close()
    again.close()


def test_gymnasium_records_what_was_dreamed(files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """RecordVideo gets the reference and each chunk's last frame; only the encoder stands aside here."""
    recorded: list[np.ndarray] = []

    class Clip:
        def __init__(self, frames: list[np.ndarray], fps: float) -> None:
            recorded.extend(frames)

        def write_videofile(self, path: str, logger: object) -> None:
            Path(path).touch()

    for name in ("moviepy", "moviepy.video", "moviepy.video.io", "moviepy.video.io.ImageSequenceClip"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules["moviepy.video.io.ImageSequenceClip"].ImageSequenceClip = Clip
    env = gym.wrappers.RecordVideo(make(files, render_mode="rgb_array"), str(tmp_path / "films"), lambda episode: True)
    env.reset(seed=0)
    shown = [env.get_wrapper_attr("references").last]
    for _ in range(2):
        _, _, _, _, info = env.step(np.repeat(env.unwrapped.joint_positions()[None], 3, 0).astype(np.float32))
        shown.append(info["frames"][-1])
    env.close()
    assert len(recorded) == 3 and all(np.array_equal(a, b) for a, b in zip(recorded, shown, strict=True))


def test_what_does_not_fit_is_refused(files, tmp_path: Path) -> None:
    state = gym.make(ID, obs_type="state", disable_env_checker=True)
    with pytest.raises(SimulationError, match="obs_type 'state' has none"):
        VisAlignerObservationWrapper(state, **files)
    pixels = gym.make(ID, obs_type="pixels", disable_env_checker=True)
    with pytest.raises(VisionError, match="64 x 48"):
        VisAlignerObservationWrapper(ActionChunk(pixels, 3, camera="head"), **files)
    with pytest.raises(VisionError, match="64 x 48"):
        VisAlignerObservationWrapper(ActionChunk(pixels, 3), **files)
    with pytest.raises(VisionError, match="does not exist"):
        VisAlignerObservationWrapper(pixels, aligner=str(tmp_path / "none.pt"), bank=files["bank"])
    state.close()
    pixels.close()


def make_vector(files, count: int = 2, **options):
    """A vector of environments, two frames at a time."""
    options = {"image_size": SIZE, "obs_type": "pixels", "disable_env_checker": True} | options
    envs = gym.vector.SyncVectorEnv(
        [lambda: ActionChunk(gym.make(ID, **options), 2, camera="head") for _ in range(count)]
    )
    return VisAlignerVectorWrapper(envs, **files)


def test_a_vector_dreams_what_each_alone_dreams(files) -> None:
    envs, single = make_vector(files), make(files, chunk=2, obs_type="pixels")
    plan = np.stack([actions(4, seed).reshape(2, 2, 14) for seed in (0, 1)], axis=1)
    observation, info = envs.reset(seed=[4, 7])
    assert observation.shape == (2, 48, 64, 3) and info["frames"].shape == (2, 2, 48, 64, 3)
    frames = [envs.step(part)[4]["frames"] for part in plan]
    for i, seed in enumerate((4, 7)):
        single.reset(seed=seed)
        for k in range(2):
            made = single.step(plan[k, i])[4]["frames"]
            assert np.abs(made.astype(int) - frames[k][i]).max() <= 1
    envs.close()
    single.close()


def test_an_episode_that_ends_in_a_vector_begins_with_a_painted_reference(files) -> None:
    envs = make_vector(files, max_episode_steps=3)
    envs.reset(seed=0)
    ended = [bool(envs.step(np.stack([actions(2)] * 2))[3].all()) for _ in range(2)]
    observation, *_, info = envs.step(np.stack([actions(2)] * 2))
    assert ended == [False, True] and info["steps"].tolist() == [0, 0]
    for i, references in enumerate(envs.references):
        assert np.array_equal(references.last, references.anchor) and np.array_equal(references.last, observation[i])
    envs.close()


def test_a_vector_of_other_environments_is_refused(files) -> None:
    plain = gym.make_vec("CartPole-v1", 2)
    with pytest.raises(VisionError, match=r"\(48, 64, 3\)"):
        VisAlignerVectorWrapper(plain, **files)
    envs = gym.vector.SyncVectorEnv(
        [lambda: gym.make(ID, obs_type="pixels", image_size=SIZE, disable_env_checker=True)]
    )
    with pytest.raises(SimulationError, match="ActionChunk"):
        VisAlignerVectorWrapper(envs, **files).reset()
    envs.close()
    plain.close()


def test_a_chunk_is_told_to_film(files) -> None:
    """In any order that can mean only one thing, and in a vector: the same frames as with camera and size stated."""
    played, clips = actions(6).reshape(2, 3, 14), []
    for compose in (
        lambda env: VisAlignerObservationWrapper(ActionChunk(env, 3, camera="head", size=SIZE), **files),
        lambda env: VisAlignerObservationWrapper(ActionChunk(env, 3), **files),
        lambda env: VisAlignerObservationWrapper(gym.wrappers.TimeLimit(ActionChunk(env, 3), 9), **files, chunk=3),
        lambda env: ActionChunk(VisAlignerObservationWrapper(env, **files), 3),
    ):
        env = compose(gym.make(ID, image_size=SIZE, disable_env_checker=True))
        assert env.action_space.shape == (3, 14)
        env.reset(seed=5)
        clips.append([env.step(part)[4]["frames"] for part in played])
        env.close()
    assert all(np.array_equal(clip, clips[0]) for clip in clips[1:])
    plain = gym.vector.SyncVectorEnv(
        [lambda: ActionChunk(gym.make(ID, image_size=SIZE, obs_type="pixels", disable_env_checker=True), 3)]
    )
    envs = VisAlignerVectorWrapper(plain, **files)
    envs.reset(seed=5)
    found = [envs.step(part[None])[4]["frames"][0] for part in played]
    assert np.abs(np.subtract(found, clips[0], dtype=int)).max() <= 1
    envs.close()


def test_what_could_mean_two_things_is_refused(files) -> None:
    env = gym.make(ID, image_size=SIZE, disable_env_checker=True)
    with pytest.raises(SimulationError, match="chunk is 4, and ActionChunk takes 3"):
        VisAlignerObservationWrapper(ActionChunk(env, 3), **files, chunk=4)
    with pytest.raises(SimulationError, match="chunks of 3 already"):
        ActionChunk(VisAlignerObservationWrapper(env, **files), 4)
    with pytest.raises(SimulationError, match="films head at 32 x 24"):
        VisAlignerObservationWrapper(ActionChunk(env, 3, camera="head", size=(32, 24)), **files)
    env.close()


def test_another_size_than_the_banks_is_refused(files) -> None:
    """Never silently the bank's."""
    env = gym.make(ID, image_size=(128, 96), disable_env_checker=True)
    for wrapped in (env, ActionChunk(env, 3)):
        with pytest.raises(
            VisionError,
            match=r"128 x 96, and the bank's photos 64 x 48; make .* image_size=\(64, 48\).* standin bank --size 128x96 --out",
        ):
            VisAlignerObservationWrapper(wrapped, **files)
    env.close()


def test_the_sensors_grain_is_added_on_request(files, tmp_path: Path) -> None:
    """The same for the same seed, of the bench's size, and not in what the next chunk follows."""
    with pytest.raises(VisionError, match="grain"):
        VisAlignerObservationWrapper(gym.make(ID, image_size=SIZE, disable_env_checker=True), **files, grain=True)
    bank = load_bank(files["bank"])
    bench = Bench(bank.plate, np.ones(bank.plate.shape[:2], bool), grain=3.0)
    save_bank(replace(bank, bench=bench), tmp_path / "grainy.npz")
    options = {"aligner": files["aligner"], "bank": str(tmp_path / "grainy.npz")}
    shown = {}
    for name, grain in (("clean", False), ("one", True), ("again", True)):
        env = VisAlignerObservationWrapper(
            gym.make(ID, image_size=SIZE, disable_env_checker=True), **options, grain=grain
        )
        first = env.reset(seed=2)[0]["pixels"]
        seen, *_, info = env.step(actions(3))
        assert np.array_equal(seen["pixels"], info["frames"][-1])
        shown[name] = np.concatenate([first[None], info["frames"]]), env.references.last
        env.close()
    assert np.array_equal(shown["one"][0], shown["again"][0])
    assert np.array_equal(shown["one"][1], shown["clean"][1])
    middle = (shown["clean"][0] > 20) & (shown["clean"][0] < 235)
    apart = (shown["one"][0].astype(float) - shown["clean"][0])[middle]
    assert apart.std() == pytest.approx(3.0, abs=0.15) and abs(apart.mean()) < 0.1
