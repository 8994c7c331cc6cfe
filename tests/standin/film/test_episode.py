"""Whole episodes, with a renderer that takes no time: what a file holds, resuming, and the command."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.cli import command as cli
from embodiedreamer_gym.envs.cameras import CAMERAS, load_cameras
from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError, RecordingError
from embodiedreamer_gym.io.progress import Progress
from embodiedreamer_gym.io.shard import Shard
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.standin.film import blender
from embodiedreamer_gym.standin.film.episode import film_episode
from embodiedreamer_gym.standin.film.run import film_episodes
from embodiedreamer_gym.standin.film.settings import FilmSettings
from embodiedreamer_gym.vis_aligner import load_episode
from tests.standin.film.grey import fake_blender, fake_python, grey, needs_bpy

FILM = FilmSettings("PutCupOnMat", size=(64, 48), frames=10, every=12)
BRIEF = FilmSettings("PutCupOnMat", size=(64, 48), frames=10)
NOISE = 2.0


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes end before the arm has reached anything."""
    monkeypatch.setattr("embodiedreamer_gym.standin.film.play.STEPS", 20)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    assert film_episode(FILM, 0, folder, render=grey) == 10
    return folder


def test_a_file_holds_what_was_played_drawn_and_filmed(filmed: Path) -> None:
    with h5py.File(FILM.path(filmed, 0)) as file:
        attributes = dict(file.attrs)
        found = {k: file[k][:] for k in ("action", "observations/qpos", "objects/cup", "objects/mat", "timestamps")}
        real, clean, masks = (file[f"observations/{k}/head"][:] for k in ("images", "clean", "masks"))
        rgb, depth, classes = (file[f"observations/sim/head/{k}"][:] for k in ("rgb", "depth", "classes"))
    assert [a.shape for a in (real, clean, rgb)] == [(10, 48, 64, 3)] * 3 and masks.shape == (10, 48, 64)
    noise = real.astype(float) - clean
    assert noise.std() == pytest.approx(np.hypot(NOISE, 1 / np.sqrt(6)), rel=0.05) and abs(noise.mean()) < 0.05
    assert np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1] < 0.05
    assert (np.diff(clean.mean(axis=(1, 2, 3))) > 0).all()  # the first frame, which is but metered, is not among them
    assert set(np.unique(classes)) <= set(range(5)) and 0.8 < (masks == classes).mean() < 1.0
    assert depth.dtype == np.float16 and depth[classes == 1].max() < 1.5
    assert found["objects/cup"].shape == (10, 7) and np.ptp(found["objects/mat"], axis=0).max() < 1e-9
    assert np.diff(found["timestamps"]) == pytest.approx(12 / 30)
    assert attributes["task"] == "PutCupOnMat" and attributes["side"] in ("left", "right")
    assert attributes["seed"] == FILM.episode_seed(0) and attributes["renderer"] == "tiny"
    assert attributes["control_hz"] == 30 and attributes["rate"] == 2.5
    assert json.loads(attributes["class_names"]) == ["background", "table", "robot", "cup", "mat"]
    assert json.loads(attributes["look"])["name"] == "lab" and json.loads(attributes["film"]) == FILM.as_dict(0)


def test_several_cameras_are_filmed_into_one_file(filmed: Path, tmp_path: Path) -> None:
    film = replace(FILM, cameras=("head", "left_wrist", "right_wrist"))
    assert film_episode(film, 0, tmp_path, render=grey) == 30
    head, again = load_episode(FILM.path(filmed, 0)), load_episode(film.path(tmp_path, 0))
    assert np.array_equal(head.frames, again.frames) and np.array_equal(head.condition.rgb, again.condition.rgb)
    wrist = load_episode(film.path(tmp_path, 0), "left_wrist")
    assert wrist.condition.moving_camera and not again.condition.moving_camera and len(wrist) == 10
    assert not np.array_equal(wrist.frames, load_episode(film.path(tmp_path, 0), "right_wrist").frames)  # other noise
    with h5py.File(film.path(tmp_path, 0)) as file:
        (tmp_path / "cameras.json").write_text(json.dumps({"cameras": json.loads(file.attrs["cameras"])}))
    assert load_cameras(tmp_path / "cameras.json") == {name: CAMERAS[name] for name in film.cameras}
    assert film_episode(film, 0, tmp_path, render=grey) == 0


def test_a_wrists_camera_is_fixed_to_its_link(tmp_path: Path, brief: None) -> None:
    scenes = []

    def seen(scene: dict) -> Iterator[np.ndarray]:
        scenes.append(scene)
        yield from grey(scene)

    film_episode(replace(BRIEF, cameras=("head", "right_wrist")), 0, tmp_path, render=seen)
    assert [scene["camera"]["body"] for scene in scenes] == [None, "right_link6"]
    assert "right_link6" in scenes[1]["moving"] and len(scenes[1]["frames"]) == 11
    metered = np.array(scenes[1]["frames"][0])[:-2]  # without the props
    assert (metered == np.array(scenes[1]["frames"][1 + 5])[:-2]).all()  # in the middle of the episode


@pytest.mark.parametrize(("cameras", "message"), [(("elbow",), "no camera 'elbow'"), (("head", "head"), "each once"),
                                                  ((), "at least one")])  # fmt: skip
def test_cameras_that_are_none_are_refused(cameras: tuple[str, ...], message: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=message):
        replace(FILM, cameras=cameras)


def test_a_file_is_a_recording_with_frames_and_a_camera(filmed: Path, tmp_path: Path) -> None:
    log = load_recordings(filmed)[0]
    assert log.units[6] == "1" and log.units[0] == "rad" and log.kind == "PutCupOnMat"
    assert len(log.frames["head"]) == 10 and log.frames["head"][3].shape == (48, 64, 3)
    with h5py.File(FILM.path(filmed, 0)) as file:
        (tmp_path / "cameras.json").write_text(json.dumps({"cameras": {"head": json.loads(file.attrs["camera"])}}))
    assert load_cameras(tmp_path / "cameras.json")["head"] == CAMERAS["head"]


def test_an_interrupted_run_goes_on(tmp_path: Path, brief: None) -> None:
    calls = []

    def tired(scene: dict) -> Iterator[np.ndarray]:
        calls.append(len(scene["frames"]))
        for number, light in enumerate(grey(scene)):
            if len(calls) == 2 and number == 5:
                raise KeyboardInterrupt
            yield light

    with pytest.raises(KeyboardInterrupt):
        film_episodes([BRIEF], 2, tmp_path, render=tired)
    assert [p.name for p in tmp_path.iterdir()] == ["PutCupOnMat_000.hdf5"]
    before = BRIEF.path(tmp_path, 0).stat().st_mtime_ns
    paths = film_episodes([BRIEF], 2, tmp_path, render=tired)
    assert calls == [11, 11, 11] and [p.name for p in paths] == ["PutCupOnMat_000.hdf5", "PutCupOnMat_001.hdf5"]
    assert BRIEF.path(tmp_path, 0).stat().st_mtime_ns == before
    film_episodes([BRIEF], 2, tmp_path, render=tired)
    assert len(calls) == 3


def test_shards_film_every_episode_once(tmp_path: Path, brief: None) -> None:
    paths = [film_episodes([BRIEF], 2, tmp_path, render=grey, shard=Shard(number, 2)) for number in (1, 2)]
    names = [f"PutCupOnMat_{number:03}.hdf5" for number in range(2)]
    assert sorted(path.name for part in paths for path in part) == names == sorted(p.name for p in tmp_path.iterdir())
    assert list(map(len, paths)) == [1, 1]


def test_other_settings_are_refused_before_anything_is_filmed(filmed: Path) -> None:
    other = FilmSettings("PutCupOnMat", "many", (64, 48), frames=10, every=12)
    with pytest.raises(RecordingError, match='filmed with look "lab", not "many"'):
        film_episodes([FilmSettings("GrabPaperCup", "many", (64, 48), frames=10), other], 1, filmed, render=grey)
    assert [p.name for p in filmed.iterdir()] == ["PutCupOnMat_000.hdf5"]


def test_processes_film_the_same_and_say_how_far_they_are(filmed: Path, tmp_path: Path, capsys) -> None:
    film_episodes([FILM], 1, tmp_path, jobs=2, progress=Progress(), render=grey)
    assert FILM.path(tmp_path, 0).read_bytes() == FILM.path(filmed, 0).read_bytes()
    assert "10 of 10 (100 %), episodes 1 of 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--task", "PutCup-v0"], "no task 'PutCup'; give one of GrabPaperCup"),
        (["--size", "128"], "--size 128 is not a width and a height; give two numbers such as 128x96"),
        (["--size", "4x4"], "4 x 4 pixels; each may be 16 to 2048"),
        (["--episodes", "-1"], "--episodes: -1 is not a whole number from 1 to"),
        (["--shard", "3/2"], "--shard: 3/2 is not a shard; give I/N such as 1/4"),
        (["--jobs", "0"], "--jobs: 0 is not a whole number from 1 to"),
        (["--frames", "3"], "frames is 3, but must be at least 10"),
        (["--appearance", "mine"], "no appearance 'mine'"),
        (["--blender", "/nowhere/python"], "/nowhere/python is not a Python interpreter"),
        (["--every", "two"], "--every: two is not a whole number"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_sentence(
    tmp_path: Path, capsys, options: list[str], message: str
) -> None:
    out = tmp_path / "films"
    assert cli.main(["standin", "film", "--out", str(out), *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and message in error and error.count("\n") == 1
    assert not out.exists()


def test_a_file_where_the_folder_should_be_is_named(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("embodiedreamer_gym.standin.film.run.find_blender", lambda blender: blender)
    (tmp_path / "films").write_text("here")
    assert cli.main(["standin", "film", "--out", str(tmp_path / "films")]) == 2
    assert "films is a file, not a folder" in capsys.readouterr().err


def test_without_blender_nothing_is_begun(tmp_path: Path) -> None:
    python = fake_python(tmp_path / "python", "3 11 False")
    with pytest.raises(MissingExtraError, match="needs Blender's module bpy"):
        film_episodes([FILM], 1, tmp_path / "films", blender=python)
    assert not (tmp_path / "films").exists() and issubclass(MissingExtraError, EmbodieDreamerError)


def test_the_command_films_every_task(tmp_path: Path, brief: None, monkeypatch, capsys) -> None:
    monkeypatch.setattr("embodiedreamer_gym.standin.film.run.find_blender", lambda blender: blender)
    monkeypatch.setattr(
        "embodiedreamer_gym.standin.film.episode.render_with_blender", lambda scene, blender: grey(scene)
    )
    options = [
        "--frames",
        "10",
        "--size",
        "32x24",
        "--appearance",
        "many",
        "--jobs",
        "1",
        "--quiet",
        "--out",
        str(tmp_path),
    ]
    assert cli.main(["standin", "film", *options]) == 0
    names = ["GrabPaperCup", "PutCupOnMat", "PutPenInCup", "PutRemoteInBox"]
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"{name}_000.hdf5" for name in names]
    assert f"4 episodes in {tmp_path}" in capsys.readouterr().out
    names = [json.loads(h5py.File(path).attrs["look"])["name"] for path in tmp_path.iterdir()]
    assert len(set(names)) == 4


def test_the_former_name_of_an_option_works_with_a_warning(tmp_path: Path, brief: None, capsys) -> None:
    python = fake_blender(tmp_path / "python")
    options = ["--task", "PutCupOnMat", "--frames", "10", "--size", "32x24", "--jobs", "1", "--quiet"]
    assert cli.main(["standin", "film", *options, "--look", "4", "--blender", python, "--out", str(tmp_path)]) == 0
    assert "warning: --look is now --appearance" in capsys.readouterr().err
    with h5py.File(tmp_path / "PutCupOnMat_000.hdf5") as file:
        assert json.loads(file.attrs["look"])["name"] == "look 4"
        assert np.ptp(file["observations/clean/head"][:]) > 30


def test_an_interpreter_that_fails_leaves_nothing_and_one_sentence(tmp_path: Path, brief: None, capsys) -> None:
    python = fake_python(tmp_path / "python", "3 11 True", "echo 'no GPU, no light' >&2; exit 1")
    options = ["--task", "PutCupOnMat", "--frames", "10", "--size", "32x24", "--jobs", "1", "--quiet"]
    assert cli.main(["standin", "film", *options, "--blender", python, "--out", str(tmp_path / "films")]) == 2
    assert capsys.readouterr().err == "error: Blender has failed: no GPU, no light.\n"
    assert not list((tmp_path / "films").iterdir())


@needs_bpy
def test_blender_films_an_episode(tmp_path: Path, brief: None) -> None:
    film = FilmSettings("PutRemoteInBox", "4", (48, 36), frames=10, samples=1)
    assert film_episodes([film], 1, tmp_path) == [film.path(tmp_path, 0)]
    pictures = load_recordings(tmp_path)[0].frames["head"]
    values = np.array([pictures[i] for i in range(10)])
    assert 60 < values.mean() < 200 and values.std() > 20
    assert blender.find_blender() and np.abs(values[0].astype(float) - values[9]).max() > 30
