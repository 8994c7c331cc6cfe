"""LeRobot v3 folders as LeRobot 0.6 writes them, whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes import LeRobotWriter, lerobot_videos, open_episodes
from embodiedreamer_gym.recordings.episodes import lerobot_writer as module

pytest.importorskip("av", reason="LeRobot sets need av: pip install 'embodiedreamer-gym[data]'")
parquet = pytest.importorskip("pyarrow.parquet", reason="LeRobot sets need pyarrow")

SIZE = (64, 48)


@pytest.fixture
def written(tmp_path: Path, numbers, shots) -> Path:
    """Two tasks, three episodes, two cameras."""
    with LeRobotWriter(tmp_path / "set", 30.0, [f"joint{k}" for k in range(14)], robot_type="aloha",
                       about={"seed": 3}) as writer:  # fmt: skip
        for seed, length in enumerate((9, 12, 5)):
            frames = {"head": shots(length, size=SIZE), "wrist": shots(length, 5, SIZE)}
            writer.add_episode(*numbers(length, seed=seed), frames, f"task {seed % 2}", velocities=None)
        assert not (tmp_path / "set").exists()
    return tmp_path / "set"


def test_it_reads_back(written: Path, numbers, seen) -> None:
    episodes = open_episodes(written)
    assert (episodes.lengths, episodes.hz, episodes.cameras) == ((9, 12, 5), 30.0, ("head", "wrist"))
    assert [episodes.task(k) for k in range(3)] == ["task 0", "task 1", "task 0"]
    assert episodes.names == ("episode_0", "episode_1", "episode_2") and episodes.frame_size("wrist") == SIZE
    for number, length in enumerate(episodes.lengths):
        state, action = numbers(length, seed=number)
        assert np.array_equal(episodes.states(number), state) and np.array_equal(episodes.actions(number), action)
        assert seen(episodes.frames(number, "head")) == list(range(length))
        for step in (length - 1, 0, 2):
            assert seen(episodes.frames(number, "wrist", step, step + 1)) == [step + 5]


def test_info(written: Path) -> None:
    info = json.loads((written / "meta/info.json").read_text())
    assert {key: info[key] for key in ("codebase_version", "fps", "total_episodes", "total_frames", "total_tasks")} == {
        "codebase_version": "v3.0", "fps": 30, "total_episodes": 3, "total_frames": 26, "total_tasks": 2,
    }  # fmt: skip
    assert info["splits"] == {"train": "0:3"} and info["robot_type"] == "aloha"
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    features = info["features"]
    assert features["action"] == {"dtype": "float32", "shape": [14], "names": [f"joint{k}" for k in range(14)]}
    head = features["observation.images.head"]
    assert (head["dtype"], head["shape"], head["names"]) == ("video", [48, 64, 3], ["height", "width", "channels"])
    assert head["info"]["video.codec"] == "h264" and head["info"]["video.g"] == 2 and head["info"]["video.fps"] == 30
    assert features["timestamp"] == {"dtype": "float32", "shape": [1], "names": None}
    assert json.loads((written / module.ABOUT).read_text()) == {"seed": 3}


def test_tables(written: Path) -> None:
    data = parquet.ParquetFile(written / "data/chunk-000/file-000.parquet")
    assert data.num_row_groups == 3  # one an episode
    table = data.read().to_pydict()
    assert table["index"] == list(range(26)) and table["episode_index"] == [0] * 9 + [1] * 12 + [2] * 5
    assert table["frame_index"][7:12] == [7, 8, 0, 1, 2] and table["task_index"][8:10] == [0, 1]
    assert np.allclose(table["timestamp"][9:12], [0, 1 / 30, 2 / 30])
    assert str(data.schema_arrow.field("action").type) == "fixed_size_list<element: float>[14]"
    rows = parquet.read_table(written / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["dataset_from_index"] for row in rows] == [0, 9, 21] and rows[2]["dataset_to_index"] == 26
    at = "videos/observation.images.head"
    assert [round(row[f"{at}/from_timestamp"] * 30) for row in rows] == [0, 9, 21]
    assert rows[1]["tasks"] == ["task 1"] and len(rows[1]["stats/action/q99"]) == 14
    assert np.shape(rows[1]["stats/observation.images.head/mean"]) == (3, 1, 1)


def test_tasks_are_a_frame_of_pandas(written: Path) -> None:
    """LeRobot takes the index of this frame for the tasks' words."""
    table = parquet.read_table(written / "meta/tasks.parquet")
    assert table.to_pydict() == {"task_index": [0, 1], "task": ["task 0", "task 1"]}
    said = json.loads(table.schema.metadata[b"pandas"])
    assert said["index_columns"] == ["task"] and {column["name"] for column in said["columns"]} == {
        "task_index",
        "task",
    }


def test_statistics(written: Path, numbers) -> None:
    stats = json.loads((written / "meta/stats.json").read_text())
    every = np.concatenate([numbers(length, seed=seed)[1] for seed, length in enumerate((9, 12, 5))])
    assert np.allclose(stats["action"]["mean"], every.mean(0), atol=1e-6)
    assert np.allclose(stats["action"]["std"], every.std(0), atol=1e-6)
    assert stats["action"]["count"] == [26] and set(stats["index"]) >= {"min", "max", "q01", "q10", "q50", "q90", "q99"}
    assert np.shape(stats["observation.images.wrist"]["std"]) == (3, 1, 1)


def test_files_turn_when_they_are_large(tmp_path: Path, numbers, shots, seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "DATA_MB", 1e-6)
    monkeypatch.setattr(lerobot_videos, "VIDEO_MB", 1e-6)
    for one in (module, lerobot_videos):
        monkeypatch.setattr(one, "CHUNK", 2)
    with LeRobotWriter(tmp_path / "set", 30) as writer:
        for seed in range(3):
            writer.add_episode(*numbers(4, seed=seed), {"head": shots(4, 7 * seed, SIZE)}, "a task")
    files = sorted(str(path.relative_to(tmp_path / "set")) for path in (tmp_path / "set").rglob("file-*"))
    assert files[:3] == [f"data/chunk-00{c}/file-00{f}.parquet" for c, f in ((0, 0), (0, 1), (1, 0))]
    assert files[-1] == "videos/observation.images.head/chunk-001/file-000.mp4"
    episodes = open_episodes(tmp_path / "set")
    for number in (2, 0, 1):
        assert np.array_equal(episodes.states(number), numbers(4, seed=number)[0])
        assert seen(episodes.frames(number, "head")) == [7 * number + k for k in range(4)]


def test_a_set_without_cameras(tmp_path: Path, numbers) -> None:
    with LeRobotWriter(tmp_path / "set", 50) as writer:
        writer.add_episode(*numbers(4, n=3), {})
    episodes = open_episodes(tmp_path / "set")
    assert episodes.cameras == () and np.array_equal(episodes.actions(0), numbers(4, n=3)[1])


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (lambda shots: {"head": shots(8, size=SIZE)}, "camera head has 8 frames for 9 steps"),
        (lambda shots: {"head": shots(10, size=SIZE)}, "camera head has more than 9 frames"),
        (lambda shots: {"head": [np.zeros((48, 64, 3))] * 9}, "is float64 of shape"),
        (lambda shots: {"head": shots(9, size=(32, 48))}, "several sizes"),
        (lambda shots: {}, "all must have the same"),
        (lambda shots: {"head": iter(lambda: 1 / 0, None)}, "division"),
    ],
)
def test_nothing_half_written_is_left(tmp_path: Path, numbers, shots, frames, message: str) -> None:
    with (
        pytest.raises((RecordingError, ZeroDivisionError), match=message),
        LeRobotWriter(tmp_path / "set", 30) as writer,
    ):
        writer.add_episode(*numbers(6), {"head": shots(6, size=SIZE)})
        writer.add_episode(*numbers(9), frames(shots))
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be(tmp_path: Path, numbers) -> None:
    with pytest.raises(RecordingError, match=r"a whole number of Hz, not 29\.97"):
        LeRobotWriter(tmp_path / "set", 29.97)
    with pytest.raises(RecordingError, match="codec 'hevc' is not one of"):
        LeRobotWriter(tmp_path / "set", 30, codec="hevc")
    with pytest.raises(RecordingError, match="exists already"):
        LeRobotWriter(tmp_path, 30)
    with pytest.raises(RecordingError, match="there is no episode to write"), LeRobotWriter(tmp_path / "set", 30):
        pass
    with pytest.raises(RecordingError, match="3 states and 4 actions"), LeRobotWriter(tmp_path / "set", 30) as writer:
        writer.add_episode(numbers(3)[0], numbers(4)[1], {})
    assert list(tmp_path.iterdir()) == []
