"""Demonstrations: what the expert did, again and again the same, whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import joblib
import numpy as np
import pytest

from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError, SimulationError
from embodiedreamer_gym.pipelines import demonstrations as module
from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations, record_lerobot
from embodiedreamer_gym.recordings.episodes import open_episodes, write_aloha_episode
from embodiedreamer_gym.vis_aligner.episodes import load_scene

REAL = Demonstrations("GrabPaperCup", 3, (16, 12), ("head", "left_wrist"))
QUICK = Demonstrations("PutCupOnMat", 0, (32, 24))
FAILING = (0, 2, 3)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes of the expert itself."""
    folder = tmp_path_factory.mktemp("real")
    assert record_demonstrations(REAL, 2, folder) == 0
    return folder


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The attempts that are made, of which those in FAILING fail; no physics."""
    made: list[int] = []

    def attempt(wanted: Demonstrations, number: int, folder: Path) -> Path | None:
        made.append(number)
        if number in FAILING:
            return None
        path = folder / f".attempt_{number}.hdf5"
        numbers = np.full((3, 14), number, np.float32)
        frames = [np.full((24, 32, 3), 20 * number, np.uint8)] * 3
        write_aloha_episode(path, numbers, numbers, {"head": frames}, "put it there", hz=30,
                            attributes={"demonstration": {**wanted.settings(), "attempt": number}})  # fmt: skip
        return path

    monkeypatch.setattr(module, "_attempt", attempt)
    return made


def attempts(folder: Path) -> list[int]:
    """Which attempts the episodes of a folder are."""
    episodes = open_episodes(folder)
    return [int(episodes.states(k)[0, 0]) for k in range(len(episodes))]


def test_an_episode_is_what_happened(real: Path) -> None:
    episodes = open_episodes(real)
    assert episodes.cameras == REAL.cameras and episodes.hz == 30 and episodes.frame_size("head") == (16, 12)
    assert "cup" in episodes.task(0) and 60 < episodes.lengths[0] < module.STEPS
    with h5py.File(real / "episode_1.hdf5") as file:
        said, objects = dict(file.attrs), {name: data[()] for name, data in file["objects"].items()}
        speeds = file["observations/qvel"][()]
    assert said["task"] == "GrabPaperCup" and said["renderer"] == "tiny" and said["seed"] == REAL.attempt_seed(1)
    assert json.loads(said["demonstration"])["attempt"] == 1 and len(json.loads(said["joint_names"])) == 14
    env = REAL.make_env()
    seen, info = env.reset(seed=int(said["seed"]))
    assert info["side"] == said["side"]
    frames, masks = episodes.frames(1, "left_wrist"), episodes.masks(1, "head")
    assert episodes.objects == {name: env.segmentation_classes.index(name) for name in objects}
    for step, (state, action) in enumerate(zip(episodes.states(1), episodes.actions(1), strict=True)):
        assert np.array_equal(seen["agent_pos"], state)
        assert step % 20 or np.array_equal(seen["pixels"]["left_wrist"], frames[step])
        assert step % 20 or np.array_equal(env.capture("head").segmentation, masks[step])
        for name, poses in objects.items():
            assert np.allclose(env.object_pose(name).position, poses[step, :3]) and poses.shape[1] == 7
        assert np.allclose(env.joint_velocities(), speeds[step], atol=1e-6)
        seen, _, _, _, info = env.step(action)
    env.close()
    assert info["is_success"] and set(objects) == {prop.name for prop in env.task.props}
    still = np.abs(np.diff(episodes.states(1)[-module.STILL :], axis=0)).max()
    assert still < module.MOVES  # it ends at rest, and not long after


def test_its_scene_can_be_set_up(real: Path) -> None:
    """As the references of the video model are: joints and props at the first frame."""
    joints, poses = load_scene(real / "episode_1.hdf5")
    env = REAL.make_env()
    env.reset(seed=99, options={"joint_positions": joints, "object_poses": poses})
    for name, pose in poses.items():
        assert np.allclose(env.object_pose(name).position, pose[:3], atol=1e-6)
    assert np.allclose(env.joint_positions(), open_episodes(real).states(1)[0], atol=1e-6)
    env.close()


def test_the_same_seed_gives_the_same_episodes(real: Path, tmp_path: Path) -> None:
    record_demonstrations(REAL, 1, tmp_path)
    one, two = open_episodes(real / "episode_0.hdf5"), open_episodes(tmp_path)
    assert np.array_equal(one.actions(0), two.actions(0)) and np.array_equal(
        one.frames(0, "head"), two.frames(0, "head")
    )
    other = Demonstrations("GrabPaperCup", 4, (16, 12), ("head", "left_wrist"))
    assert len({wanted.attempt_seed(k) for wanted in (REAL, other, QUICK) for k in range(9)}) == 27


@pytest.mark.parametrize("jobs", [1, 3])
def test_failures_are_counted_and_left_out(quick: list[int], tmp_path: Path, jobs: int) -> None:
    told: list[tuple[Any, ...]] = []
    with joblib.parallel_config("threading"):  # which the stand-in for the expert needs
        failed = record_demonstrations(
            QUICK, 4, tmp_path, jobs, lambda *said, **named: told.append((*said, named["failed_attempts"]))
        )
    assert failed == 3 and attempts(tmp_path) == [1, 4, 5, 6]
    counts = [(0, 1), (1, 1), (1, 2), (1, 3), (2, 3), (3, 3), (4, 3)]
    assert told == [("episodes", done, 4, lost) for done, lost in counts]
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"episode_{k}.hdf5" for k in range(4)]
    assert sorted(quick) == list(range(7))  # none too many


def test_it_goes_on_where_it_was(quick: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempt = module._attempt

    def interrupted(wanted: Demonstrations, number: int, folder: Path) -> Path | None:
        if number == 5:
            (folder / ".attempt_5.hdf5.part").touch()
            raise KeyboardInterrupt
        return attempt(wanted, number, folder)

    monkeypatch.setattr(module, "_attempt", interrupted)
    with pytest.raises(KeyboardInterrupt):
        record_demonstrations(QUICK, 4, tmp_path)
    assert attempts(tmp_path) == [1, 4]
    monkeypatch.setattr(module, "_attempt", attempt)
    quick.clear()
    assert record_demonstrations(QUICK, 4, tmp_path) == 3
    assert quick == [5, 6] and attempts(tmp_path) == [1, 4, 5, 6]
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    quick.clear()
    assert record_demonstrations(QUICK, 4, tmp_path) == 3 and quick == []


def test_an_expert_that_always_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_attempt", lambda *a: None)
    with pytest.raises(SimulationError, match=r"succeeded in 0 of \d+ attempts at PutCupOnMat with robot aloha"):
        record_demonstrations(QUICK, 2, tmp_path)


def test_an_attempt_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STEPS", 5)
    assert module._attempt(REAL, 0, tmp_path) is None
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RecordingError, match="nothing cannot be written: No such file"):
        module._attempt(REAL, 0, tmp_path / "nothing")


def test_a_folder_with_other_things(quick: list[int], tmp_path: Path) -> None:
    record_demonstrations(QUICK, 1, tmp_path)
    with pytest.raises(RecordingError, match="was made with seed 0, not 7; give another folder, or the same options"):
        record_demonstrations(Demonstrations("PutCupOnMat", 7, (32, 24)), 1, tmp_path)
    (tmp_path / "episode_0.hdf5").rename(tmp_path / "episode_3.hdf5")
    with pytest.raises(RecordingError, match=r"has other episodes, but no episode_0\.hdf5"):
        record_demonstrations(QUICK, 1, tmp_path)
    h5py.File(tmp_path / "episode_0.hdf5", "w").close()
    (tmp_path / "episode_3.hdf5").unlink()
    with pytest.raises(RecordingError, match="and is not a demonstration"):
        record_demonstrations(QUICK, 1, tmp_path)
    with pytest.raises(RecordingError, match="cannot be created"):
        record_demonstrations(QUICK, 1, tmp_path / "episode_0.hdf5")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Demonstrations("Fly"), "there is no task 'Fly'; give one of GrabPaperCup"),
        (lambda: Demonstrations("PutCupOnMat", -1), "the seed is -1"),
        (lambda: record_demonstrations(Demonstrations("PutCupOnMat", size=(4, 4)), 1, "x"), "not a width and height"),
        (lambda: record_demonstrations(Demonstrations("PutCupOnMat", cameras=("foot",)), 1, "x"), "camera 'foot'"),
        (lambda: record_demonstrations(Demonstrations("PutCupOnMat", robot="r2d2"), 1, "x"), "r2d2"),
    ],
)
def test_what_cannot_be(make: Callable[[], Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EmbodieDreamerError, match=message):
        make()
    assert list(tmp_path.iterdir()) == []


def test_a_lerobot_set(quick: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("av", reason="LeRobot sets need av")
    pytest.importorskip("pyarrow", reason="LeRobot sets need pyarrow")
    with monkeypatch.context() as broken, pytest.raises(RecordingError, match="no"):
        broken.setattr(module, "copy_episodes", lambda *a, **k: (_ for _ in ()).throw(RecordingError("no")))
        record_lerobot(QUICK, 2, tmp_path / "set")
    assert not (tmp_path / "set").exists()
    quick.clear()
    assert record_lerobot(QUICK, 2, tmp_path / "set") == 3
    assert quick == [] and [path.name for path in tmp_path.iterdir()] == ["set"]
    episodes = open_episodes(tmp_path / "set")
    assert attempts(tmp_path / "set") == [1, 4] and episodes.task(0) == "put it there" and episodes.hz == 30
    assert abs(episodes.frames(1, "head").mean() - 80) < 2
    names = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]["action"]["names"]
    assert names[0] == "left_joint1"
    assert record_lerobot(QUICK, 2, tmp_path / "set") == 3 and quick == []
    with pytest.raises(RecordingError, match="was made with episodes 2, not 3"):
        record_lerobot(QUICK, 3, tmp_path / "set")
    with pytest.raises(RecordingError, match="width and height must be even"):
        record_lerobot(Demonstrations("PutCupOnMat", size=(33, 24)), 1, tmp_path / "odd")
    (tmp_path / "full").mkdir()
    with pytest.raises(RecordingError, match="and is not a set of demonstrations"):
        record_lerobot(QUICK, 1, tmp_path / "full")


def test_recorded_episodes_are_retargeted_to_new_scenes(tmp_path: Path) -> None:
    """From three scripted episodes, others of other scenes that succeed as well."""
    few = Demonstrations("GrabPaperCup", 5, (16, 12))
    record_demonstrations(few, 3, tmp_path / "few")
    wanted = Demonstrations("GrabPaperCup", 11, (16, 12), retarget=str(tmp_path / "few"))
    failed = record_demonstrations(wanted, 2, tmp_path / "more")
    scripted = Demonstrations("GrabPaperCup", 11, (16, 12))
    assert failed <= 2
    with h5py.File(tmp_path / "more" / "episode_0.hdf5") as file:
        about = json.loads(file.attrs["demonstration"])
        cup, seed = file["objects/cup"][:], int(file.attrs["seed"])
    assert about["retarget"] == wanted.settings()["retarget"] and seed == scripted.attempt_seed(about["attempt"])
    assert cup[-1, 2] > cup[0, 2] + 0.05  # lifted
    record_demonstrations(few, 4, tmp_path / "few")
    with pytest.raises(RecordingError, match="retarget"):  # others than those from which the first two were made
        record_demonstrations(replace(wanted), 3, tmp_path / "more")
    with pytest.raises(RecordingError, match="are of GrabPaperCup, not PutCupOnMat"):
        Demonstrations("PutCupOnMat", retarget=str(tmp_path / "few"))
