"""Recorded episodes filmed anew: the same actions, other pictures, and nothing half-written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import pytest

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError, VisionError
from embodiedreamer_gym.pipelines import regenerate as module
from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
from embodiedreamer_gym.pipelines.regenerate import Regenerated, regenerate
from embodiedreamer_gym.pipelines.replay_episodes import Played, play, read_source
from embodiedreamer_gym.recordings.episodes import open_episodes
from embodiedreamer_gym.vis_aligner.editing import Background, PaperSheet, Recolour


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One episode in which a cup is lifted."""
    folder = tmp_path_factory.mktemp("regenerate") / "demos"
    record_demonstrations(Demonstrations("GrabPaperCup", size=(32, 24)), 1, folder)
    return folder


@pytest.fixture(scope="module")
def replayed(demos: Path) -> Played:
    return play(read_source(demos / "episode_0.hdf5"), (128, 96))


class Still:
    """An aligner that costs nothing: the first frame, for ever."""

    name, chunk = "still", 50

    def render(self, references: Any, conditions: Any) -> list[np.ndarray]:
        return [np.repeat(r.last[None], len(c), axis=0) for r, c in zip(references, conditions, strict=True)]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(module, "load_aligner", lambda name: Still())
    return "still"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, replayed: Played) -> list[str]:
    """Replays cost nothing, and are listed."""
    made: list[str] = []

    def again(source: Any, size: Any, cameras: Any) -> Played:
        made.append(source.name)
        return replayed

    monkeypatch.setattr(module, "play", again)
    return made


def about(path: Path) -> dict[str, Any]:
    with h5py.File(path, "r") as file:
        return json.loads(str(file.attrs["augmentation"]))


def plain_log(demos: Path, path: Path, *without: str) -> Path:
    """The episode as a log that does not know how it was made."""
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((demos / "episode_0.hdf5").read_bytes())
    with h5py.File(path, "r+") as file:
        for key in ("demonstration", "seed", *without):
            del (file if key in file else file.attrs)[key]
    return path


def test_a_replay_is_the_episode_again(demos: Path, replayed: Played) -> None:
    source, there = read_source(demos / "episode_0.hdf5"), open_episodes(demos)
    assert len(replayed.views["head"]) == there.lengths[0] and replayed.success and replayed.error < 1e-5
    assert replayed.names == ("background", "table", "robot", "cup")
    small = play(source, (32, 24)).views["head"].rgb
    assert np.array_equal(small, there.frames(0, "head"))  # each of them, at its step


def test_only_the_frames_are_new(demos: Path, tmp_path: Path, quick: list[str]) -> None:
    editor = Recolour(("cup",), (40, 70, 220))
    assert regenerate(demos, tmp_path, editor=editor) == Regenerated(1, 0, ())
    old, new = open_episodes(demos), open_episodes(tmp_path)
    assert np.array_equal(old.states(0), new.states(0)) and np.array_equal(old.actions(0), new.actions(0))
    assert new.cameras == ("head",) and new.frame_size("head") == (128, 96) and new.hz == old.hz
    assert new.names == ("episode_0_0",) and new.task(0) == "grab the paper cup"
    with h5py.File(tmp_path / "episode_0_0.hdf5") as one, h5py.File(demos / "episode_0.hdf5") as two:
        assert np.array_equal(one["objects/cup"], two["objects/cup"]) and one.attrs["task"] == "GrabPaperCup"
        assert np.array_equal(one["observations/qvel"], two["observations/qvel"])
        assert "demonstration" not in one.attrs and one.attrs["side"] == two.attrs["side"]
    told = about(tmp_path / "episode_0_0.hdf5")
    assert {key: told[key] for key in ("source", "copy", "aligner", "bank", "seed", "prompt")} == {
        "source": "episode_0", "copy": 0, "aligner": "lean", "bank": "lab", "seed": 0, "prompt": None,
    }  # fmt: skip
    assert told["edit"] == "Recolour(names=('cup',), colour=(40, 70, 220))" and told["replay_error"] < 1e-5
    assert told["draws"]["cup"]["hue"] == pytest.approx(230, abs=1)


def test_the_new_looks_last_to_the_end(demos: Path, replayed: Played, tmp_path: Path, quick: list[str]) -> None:
    """Of the shipped model: the cup keeps the colour it was given, and the table's is where the cup was."""
    regenerate(demos, tmp_path / "cup", editor=Recolour(("cup",), (40, 70, 220)))
    regenerate(demos, tmp_path / "table", editor=Background(("table",)))
    regenerate(demos, tmp_path / "plain")
    blue, table, plain = (open_episodes(tmp_path / n).frames(0, "head") for n in ("cup", "table", "plain"))
    classes = replayed.views["head"].classes
    cup = classes == 3
    for chunk in range(0, len(blue), 8):  # the cup, in every chunk down to the last; blurred while it moves
        before, after = (f[chunk : chunk + 8][cup[chunk : chunk + 8]].mean(axis=0) for f in (plain, blue))
        assert (after[2] - after[0]) - (before[2] - before[0]) > 30
    left = cup[0] & (classes[-1] == 1)  # where the cup stood
    near = (cv2.dilate(left.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0) & (classes == 1).all(axis=0)
    assert left.sum() > 10 and near.sum() > 10
    new, around, old = table[-1][left].mean(axis=0), table[0][near].mean(axis=0), plain[-1][left].mean(axis=0)
    change = np.abs(old - around).max()  # of which the model's own trace of the cup spoils a little
    assert change > 25 and np.abs(new - around).max() < 0.3 * change


def test_a_sheet_under_what_is_taken_away(demos: Path, replayed: Played, tmp_path: Path, quick: list[str]) -> None:
    x, y = read_source(demos / "episode_0.hdf5").objects["cup"][0, :2].tolist()
    regenerate(demos, tmp_path, editor=PaperSheet(CAMERAS["head"], pose=(x, y, 0.0)))
    frames, classes = open_episodes(tmp_path).frames(0, "head"), replayed.views["head"].classes
    assert np.array_equal(open_episodes(tmp_path).masks(0, "head"), classes)
    left = (classes[0] == 3) & (classes[-1] == 1)
    assert frames[-1][left].mean() > 200 and np.ptp(frames[-1][left].mean(axis=0)) < 20


def test_it_goes_on_and_is_the_same_again(demos: Path, small: str, tmp_path: Path, quick: list[str]) -> None:
    told: list[tuple[int, int, int]] = []
    options = {
        "aligner": small,
        "editor": Recolour(),
        "progress": lambda stage, *x, **more: told.append((*x, more["failed"])),
    }
    assert regenerate(demos, tmp_path / "a", **options) == Regenerated(1, 0, ())
    first = (tmp_path / "a" / "episode_0_0.hdf5").stat().st_mtime_ns
    assert regenerate(demos, tmp_path / "a", copies=2, **options) == Regenerated(1, 1, ())
    assert regenerate(demos, tmp_path / "a", copies=2, **options) == Regenerated(0, 2, ())
    assert (tmp_path / "a" / "episode_0_0.hdf5").stat().st_mtime_ns == first
    assert quick == ["episode_0"] * 2 and told == [(1, 1, 0)] * 3
    regenerate(demos, tmp_path / "b", copies=2, **options)
    a, b = open_episodes(tmp_path / "a"), open_episodes(tmp_path / "b")
    assert a.names == b.names == ("episode_0_0", "episode_0_1")
    for number in range(2):
        assert np.array_equal(a.frames(number, "head"), b.frames(number, "head"))
    assert not np.array_equal(a.frames(0, "head", 0, 1), a.frames(1, "head", 0, 1))  # other draws
    for changed in ({"seed": 1}, {"editor": None}, {"prompt": "red"}):
        with pytest.raises(
            RecordingError, match=f"was made with {'edit' if 'editor' in changed else next(iter(changed))}"
        ):
            regenerate(demos, tmp_path / "a", **(options | changed))


def test_another_episode_of_the_same_name_is_not_taken_for_done(demos: Path, small: str, tmp_path: Path, quick) -> None:
    other = plain_log(demos, tmp_path / "logs" / "episode_0.hdf5")
    regenerate(demos, tmp_path / "out", small)
    before = (tmp_path / "out" / "episode_0_0.hdf5").read_bytes()
    with h5py.File(other, "r+") as file:
        file["action"][3, 2] += 1e-6
    with pytest.raises(
        RecordingError, match=r"was made from a different episode episode_0 than .*logs.*; give another folder"
    ):
        regenerate(other, tmp_path / "out", small)
    assert (tmp_path / "out" / "episode_0_0.hdf5").read_bytes() == before


def test_what_fails_is_counted_and_left_out(demos: Path, small: str, tmp_path: Path) -> None:
    """The actions of another scene: the gripper closes beside the cup."""
    log = plain_log(demos, tmp_path / "logs" / "moved.hdf5")
    with h5py.File(log, "r+") as file:
        file["objects/cup"][:, 0] += 0.1
    assert regenerate([demos, log], tmp_path / "out", small) == Regenerated(1, 0, ("moved",))
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["episode_0_0.hdf5"]


def test_a_log_that_says_where_the_objects_were(demos: Path, small: str, tmp_path: Path) -> None:
    log = plain_log(demos, tmp_path / "logs" / "log.hdf5", "task")
    with pytest.raises(RecordingError, match="does not state its task; give one of"):
        regenerate(log, tmp_path / "out", small)
    assert regenerate(log, tmp_path / "out", small, task="GrabPaperCup").written == 1
    assert about(tmp_path / "out" / "log_0.hdf5")["replay_error"] < 0.01
    bare = plain_log(demos, tmp_path / "logs" / "bare.hdf5", "objects")
    with pytest.raises(RecordingError, match="needs the poses of the task's objects, /objects/cup, and has none"):
        regenerate(bare, tmp_path / "none", small)


def test_an_episodes_own_first_frame(demos: Path, small: str, tmp_path: Path) -> None:
    regenerate(demos, tmp_path, small, None)
    assert np.array_equal(open_episodes(tmp_path).frames(0, "head", 0, 1), open_episodes(demos).frames(0, "head", 0, 1))


def test_head_and_wrists_are_generated_together(tmp_path: Path) -> None:
    """Each wrist's frames follow its own camera: in closed loop nearer to the simulator's than the first frame is."""
    cameras = ("head", "left_wrist", "right_wrist")
    record_demonstrations(Demonstrations("GrabPaperCup", size=(64, 48), cameras=cameras), 1, tmp_path / "demos")
    assert regenerate(tmp_path / "demos", tmp_path / "out", bank=None, cameras=cameras) == Regenerated(1, 0, ())
    before, after = open_episodes(tmp_path / "demos"), open_episodes(tmp_path / "out")
    assert after.cameras == before.cameras == cameras
    nearer = []
    for name in cameras:
        true, made = (e.frames(0, name).astype(float) for e in (before, after))
        assert made.shape == true.shape and np.array_equal(made[0], true[0])
        here = slice(8, 40)
        nearer.append(np.abs(made[here] - true[here]).mean() / max(np.abs(true[:1] - true[here]).mean(), 1e-6))
    assert min(nearer[1:]) < 0.7, nearer  # of the arm that moves
    for others in (cameras[:2], cameras[:1]):
        with pytest.raises(RecordingError, match="cameras"):
            regenerate(tmp_path / "demos", tmp_path / "out", bank=None, cameras=others)


def empty(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("options", "said", "kind"),
    [
        ({"copies": 0}, "must be at least 1", RecordingError),
        ({"copies": 2}, "all 2 copies would be the same", RecordingError),
        ({"editor": lambda *_: None}, "returned NoneType", VisionError),
        ({"editor": Recolour(("pen",))}, "no 'pen' to edit", VisionError),
        ({"cameras": ("head", "nose")}, "one or more of head", RecordingError),
        ({"cameras": ()}, "not none", RecordingError),
        ({"cameras": ("head", "left_wrist"), "editor": Recolour(("cup",))}, "one camera", RecordingError),
    ],
)
def test_bad_settings(demos: Path, small: str, tmp_path: Path, quick, options, said: str, kind: type) -> None:
    with pytest.raises(kind, match=said):
        regenerate(demos, tmp_path / "out", small, **options)
    assert not list((tmp_path / "out").glob("*"))


def test_an_aligner_that_there_is_not(demos: Path, tmp_path: Path) -> None:
    with pytest.raises(VisionError, match=r"none\.pt does not exist"):
        regenerate(demos, tmp_path / "out", "none.pt")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("harm", ["cut", "other", "twice", "empty"])
def test_damaged_episodes(demos: Path, small: str, tmp_path: Path, harm: str) -> None:
    folder, out = empty(tmp_path / "in"), tmp_path / "out"
    whole = (demos / "episode_0.hdf5").read_bytes()
    given: Any = folder
    damage: dict[str, Callable[[], Any]] = {
        "cut": lambda: (folder / "episode_0.hdf5").write_bytes(whole[: len(whole) // 2]),
        "other": lambda: (empty(out) / "mine.hdf5").write_bytes(whole) and (folder / "a.hdf5").write_bytes(whole),
        "twice": lambda: (folder / "episode_0.hdf5").write_bytes(whole),
        "empty": lambda: None,
    }
    damage[harm]()
    given = [folder, demos] if harm == "twice" else folder
    said = {"cut": "damaged, cut short", "other": "mine.hdf5 exists already", "twice": "two episodes are named",
            "empty": "no HDF5 episode"}[harm]  # fmt: skip
    with pytest.raises(EmbodieDreamerError, match=said) as caught:
        regenerate(given, out, small)
    assert "\n" not in str(caught.value)
    assert [path.name for path in out.glob("*")] == (["mine.hdf5"] if harm == "other" else [])


def test_a_seed_that_is_no_number_is_refused(demos: Path, tmp_path: Path) -> None:
    path = tmp_path / "episode_0.hdf5"
    path.write_bytes((demos / "episode_0.hdf5").read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["seed"] = "[1,2]"
    with pytest.raises(RecordingError, match=r"episode_0\.hdf5: the attribute seed is no whole number"):
        read_source(path)
