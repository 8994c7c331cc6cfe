"""Sets of strangers: what does not fit is one sentence, and no file outside the set is opened."""

from __future__ import annotations

import json
import os
import pickle  # noqa: TID251  as worker processes hand a set on
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.errors import MissingExtraError, RecordingError
from embodiedreamer_gym.recordings import extras
from embodiedreamer_gym.recordings.episodes import LeRobotWriter, lerobot, open_episodes

pytest.importorskip("av", reason="LeRobot sets need av: pip install 'embodiedreamer-gym[data]'")
parquet = pytest.importorskip("pyarrow.parquet", reason="LeRobot sets need pyarrow")
arrow = pytest.importorskip("pyarrow")

DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"
HEAD = "observation.images.head"
FILM = f"videos/{HEAD}/chunk-000/file-000.mp4"


@pytest.fixture
def folder(tmp_path: Path, numbers, shots) -> Path:
    with LeRobotWriter(tmp_path / "set", 30) as writer:
        for seed, length in enumerate((6, 8)):
            writer.add_episode(*numbers(length, n=3, seed=seed), {"head": shots(length, size=(64, 48))}, "a task")
    return tmp_path / "set"


def info(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    """What changes meta/info.json."""

    def apply(folder: Path) -> None:
        path = folder / "meta/info.json"
        data = json.loads(path.read_text())
        change(data)
        path.write_text(json.dumps(data))

    return apply


def setting(*keys: str, value: Any) -> Callable[[Path], None]:
    def change(data: dict[str, Any]) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = value

    return info(change)


def column(path: str, name: str, change: Callable[[list[Any]], list[Any]]) -> Callable[[Path], None]:
    """What changes a column of a table."""

    def apply(folder: Path) -> None:
        table = parquet.read_table(folder / path)
        at = table.schema.get_field_index(name)
        parquet.write_table(table.set_column(at, name, arrow.array(change(table[name].to_pylist()))), folder / path)

    return apply


def cut(path: str) -> Callable[[Path], None]:
    return lambda folder: (folder / path).write_bytes((folder / path).read_bytes()[:150])


def gone(path: str) -> Callable[[Path], None]:
    return lambda folder: (folder / path).unlink()


def hole(rows: list[list[float]]) -> list[list[float]]:
    rows[7][1] = float("nan")
    return rows


OPENING = {
    "version 'v1.6'; v2.0, v2.1 and v3 are read": setting("codebase_version", value="v1.6"),
    "meta/info.json is missing": gone("meta/info.json"),
    "is not readable JSON": lambda folder: (folder / "meta/info.json").write_text("{"),
    "features must be an object": setting("features", value=3),
    "fps must be a number above 0, not 0": setting("fps", value=0),
    "total_episodes must be a whole number": setting("total_episodes", value="2"),
    r"has 2 episodes, meta/info\.json states 3": setting("total_episodes", value=3),
    "the episodes have 14 steps": setting("total_frames", value=15),
    "feature observation.state is missing": info(lambda data: data["features"].pop("observation.state")),
    "the shape of action must be 1 whole numbers": setting("features", "action", "shape", value=[2, 7]),
    "claims 1000000000 numbers": setting("features", "action", "shape", value=[10**9]),
    f"{HEAD} claims 90000 x 48": setting("features", HEAD, "shape", value=[48, 90000, 3]),
    "are stored in the tables as images": setting("features", HEAD, "dtype", value="image"),
    "outside the set": setting("data_path", value="../{chunk_index}/{file_index}.parquet"),
    "names the file /etc/passwd": setting("data_path", value="/etc/passwd"),
    "names the file a/../../b": setting("video_path", value="a/../../b"),
    r"not '\{chunk_index.__class__\}'": setting("data_path", value="{chunk_index.__class__}"),
    r"data_path must be a path with fields such as \{chunk_index\}": setting(
        "data_path", value="{chunk_index:999999999d}"
    ),
    "must be a path": setting("data_path", value="{"),
    "file-000.parquet: the column length is missing": lambda folder: parquet.write_table(
        parquet.read_table(folder / EPISODES).drop_columns(["length"]), folder / EPISODES
    ),
    "length of episode 0 is 0": column(EPISODES, "length", lambda rows: [0, 8]),
    "from_timestamp of episode 1 is nan": column(
        EPISODES, f"videos/{HEAD}/from_timestamp", lambda rows: [0.0, float("nan")]
    ),
    "not a parquet table": cut(EPISODES),
    f"{FILM}, which holds episode 0, is missing": gone(FILM),
    f"{DATA}, which holds episode 0, is missing": gone(DATA),
}
READING = {
    "episode 1 has 7 steps, but 8": lambda folder: parquet.write_table(
        parquet.read_table(folder / DATA).slice(0, 13), folder / DATA
    ),
    "observation.state does not have the 4 numbers per step": setting(
        "features", "observation.state", "shape", value=[4]
    ),
    "not finite at step 1, column 1": column(DATA, "observation.state", hole),
    "does not have the 3 numbers": column(
        DATA, "observation.state", lambda rows: [[1.0] * (2 + 2 * (k % 2)) for k in range(14)]
    ),
    "has gaps": column(DATA, "observation.state", lambda rows: [*rows[:9], None, *rows[10:]]),
    "numbers of shape": column(DATA, "observation.state", lambda rows: [["a"] * 3] * 14),
    "the column observation.state is missing": lambda folder: parquet.write_table(
        parquet.read_table(folder / DATA).drop_columns(["observation.state"]), folder / DATA
    ),
    "not a parquet table": cut(DATA),
    r"the frames are 64 x 48, not 62 x 48": setting("features", HEAD, "shape", value=[48, 62, 3]),
    "damaged, cut short or not a video": cut(FILM),
    "it ends before": column(EPISODES, f"videos/{HEAD}/from_timestamp", lambda rows: [0.0, 0.3]),
}


@pytest.mark.parametrize("message", OPENING)
def test_a_set_that_is_not_opened(folder: Path, message: str) -> None:
    OPENING[message](folder)
    with pytest.raises(RecordingError, match=message) as caught:
        open_episodes(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("message", READING)
def test_an_episode_that_is_not_read(folder: Path, message: str) -> None:
    READING[message](folder)
    episodes = open_episodes(folder)
    with pytest.raises(RecordingError, match=message) as caught:
        (episodes.states(1), episodes.frames(1, "head"))
    assert "\n" not in str(caught.value)


def test_tables_of_other_writers(folder: Path, numbers) -> None:
    """Lists of any length, numbers of double precision, depth videos, and the columns of a single number."""
    column(DATA, "observation.state", lambda rows: rows)(folder)
    column(DATA, "action", lambda rows: [row[0] for row in rows])(folder)
    setting("features", "action", "shape", value=[1])(folder)
    setting("features", "observation.images.depth", value={"dtype": "video", "shape": [48, 64, 1]})(folder)
    episodes = open_episodes(folder)
    state, action = numbers(8, n=3, seed=1)
    assert episodes.cameras == ("head",) and episodes.action_size == 1
    assert np.array_equal(episodes.states(1), state) and np.array_equal(episodes.actions(1), action[:, :1])


def test_a_relative_folder_and_another_process(folder: Path, seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    episodes = open_episodes("set")
    monkeypatch.chdir("/")
    again = pickle.loads(pickle.dumps(episodes))
    for one in (episodes, again):
        assert seen(one.frames(1, "head", 2, 5)) == [2, 3, 4]


def test_without_the_extra(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(extras.importlib, "import_module", absent)
    with pytest.raises(MissingExtraError, match=r"pip install 'embodiedreamer-gym\[data\]'"):
        open_episodes(folder)
    shutil.rmtree(folder)
    with pytest.raises(MissingExtraError, match="LeRobot sets need"):
        LeRobotWriter(folder, 30)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_no_table(tmp_path) -> None:
    """It is refused without being opened, which would block."""
    pytest.importorskip("pyarrow")
    os.mkfifo(tmp_path / "file.parquet")
    with pytest.raises(RecordingError, match="is not a regular file"):
        lerobot._read_table(tmp_path / "file.parquet", [])
