"""Episodes of a LeRobot folder, v2.0 to v3: numbers in parquet tables, frames in videos.

Source: lerobot/datasets (dataset_metadata.py, dataset_reader.py) of huggingface/lerobot 0.6.1.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.files import check_regular
from embodiedreamer_gym.recordings.csv_text import lines_of, open_text
from embodiedreamer_gym.recordings.episodes.episode_set import Episode, EpisodeSet, check_numbers
from embodiedreamer_gym.recordings.episodes.lerobot_info import Info, inside, read_info
from embodiedreamer_gym.recordings.episodes.video import VideoReader
from embodiedreamer_gym.recordings.extras import load_extra
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS


@dataclass(frozen=True, eq=False)
class LeRobotEpisode(Episode):
    """One episode: its table, and each camera's video with the second at which the episode begins.

    info, reader: of the set.
    """

    number: int
    length: int
    task: str
    table: Path
    videos: dict[str, tuple[Path, float]]
    info: Info
    reader: VideoReader | None

    def frames(self, camera: str, start: int, stop: int) -> np.ndarray:
        """Frames start .. stop - 1 of an existing camera, at least one."""
        path, begin = self.videos[camera]
        times = begin + np.arange(start, stop) / self.info.hz
        return self.reader.read(path, times, self.info.hz, self.info.cameras[camera][1:])  # pyright: ignore[reportOptionalMemberAccess]

    def numbers(self, key: str) -> np.ndarray:
        """States (T, n), actions (T, m) or another signal that info lists, float32."""
        table, width = self.table, self.info.widths[key]
        column = _read_table(table, [key], [("episode_index", "=", self.number)]).column(key).combine_chunks()
        nested = hasattr(column.type, "value_type")
        flat = column.flatten() if nested else column
        if column.null_count or flat.null_count:
            raise RecordingError(f"{table}: {key} of episode {self.number} has gaps; leave that episode out")
        if len(column) != self.length:
            raise RecordingError(
                f"{table}: episode {self.number} has {len(column)} steps, but {self.length} in meta/episodes"
            )
        if len(flat) != width * self.length or (nested and set(_sizes(column)) != {width}):
            raise RecordingError(
                f"{table}: {key} does not have the {width} numbers per step that meta/info.json states"
            )
        values = flat.to_numpy(zero_copy_only=False).reshape(self.length, width)
        return check_numbers(values, f"{table}: {key} of episode {self.number}")


class LeRobotEpisodes(EpisodeSet):
    """Episodes of a LeRobot folder; cameras are named without `observation.images.`.

    videos: False for the numbers alone, which need neither av nor the files of videos.
    Raises: RecordingError where something is missing or does not fit; MissingExtraError without pyarrow or av.
    """

    def __init__(self, folder: str | Path, videos: bool = True) -> None:
        folder = Path(folder).absolute()  # a relative path might look like another protocol to ffmpeg
        self.info = info = read_info(folder, videos)
        load_extra("pyarrow.parquet")
        episodes = _read_episodes(folder, info, VideoReader() if info.cameras else None)
        sizes = {camera: (width, height) for camera, (_, width, height) in info.cameras.items()}
        names = [f"episode_{one.number}" for one in episodes]
        super().__init__(str(folder), names, episodes, info.state_size, info.action_size, sizes, info.hz)
        if sum(self.lengths) != info.frames:
            raise RecordingError(
                f"{self.source}: the episodes have {sum(self.lengths)} steps, but meta/info.json states {info.frames}"
            )


def _read_table(path: Path, columns: list[str], filters: Any = None) -> Any:
    """Columns of a table; whatever pyarrow finds wrong with it becomes one sentence. filters: of its rows."""
    parquet = load_extra("pyarrow.parquet")
    check_regular(path, RecordingError)
    try:
        with parquet.ParquetFile(path) as file:
            missing = [name for name in columns if name not in file.schema_arrow.names]
            if missing:
                raise RecordingError(f"{path}: the column {missing[0]} is missing")
            _check_size(file.metadata, columns, path)
        return parquet.read_table(path, columns=columns, filters=filters, partitioning=None)
    except (load_extra("pyarrow").ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{path}: damaged, cut short or not a parquet table; copy it again") from error


def _read_episodes(folder: Path, info: Info, reader: VideoReader | None) -> list[LeRobotEpisode]:
    """All episodes, from meta/episodes, or meta/episodes.jsonl of a v2 set."""
    if info.chunk is not None:
        rows = _v2_rows(folder / "meta" / "episodes.jsonl", info, info.chunk)
        return [_episode(row, folder, info, reader) for row in rows]
    columns = ["episode_index", "length", "tasks", "data/chunk_index", "data/file_index"]
    for key, _, _ in info.cameras.values():
        columns += [f"videos/{key}/{what}" for what in ("chunk_index", "file_index", "from_timestamp")]
    paths = sorted((folder / "meta" / "episodes").glob("*/*.parquet"))
    rows = [row for path in paths for row in _read_table(path, columns).to_pylist()]
    _check_numbering(folder, [row["episode_index"] for row in rows], info)
    return [_episode(row, folder, info, reader) for row in rows]


def _check_numbering(folder: Path, numbers: list[Any], info: Info) -> None:
    """Raises: RecordingError where the episodes are not as many as info says, numbered from 0."""
    if numbers != list(range(info.episodes)):
        raise RecordingError(
            f"{folder}: meta/episodes has {len(numbers)} episodes, meta/info.json states {info.episodes}; "
            "they must be numbered from 0 without a gap"
        )


def _v2_rows(path: Path, info: Info, chunk: int) -> list[dict[str, Any]]:
    """The rows of meta/episodes.jsonl, with the columns that meta/episodes of a v3 set has."""
    rows = []
    with open_text(path) as file:
        for number, line in enumerate(lines_of(file, path), 1):
            try:
                row = json.loads(line)
            except (ValueError, RecursionError) as error:
                raise RecordingError(f"{path}: line {number} is not JSON") from error
            if not isinstance(row, dict) or len(rows) == info.episodes:
                raise RecordingError(
                    f"{path}: line {number} is not an object, or is one more than the {info.episodes} of meta/info.json"
                )
            rows.append({key: row.get(key) for key in ("episode_index", "length", "tasks")})
    _check_numbering(path.parent.parent, [row["episode_index"] for row in rows], info)
    for k, row in enumerate(rows):
        row |= {"data/chunk_index": k // chunk, "data/file_index": k}
        for key, _, _ in info.cameras.values():
            at = f"videos/{key}/"
            row |= {f"{at}chunk_index": k // chunk, f"{at}file_index": k, f"{at}from_timestamp": 0.0}
    return rows


def _episode(row: dict[str, Any], folder: Path, info: Info, reader: VideoReader | None) -> LeRobotEpisode:
    """One episode, from its row of meta/episodes.

    Raises: RecordingError where one of its files is missing, or a value is impossible.
    """
    number = row["episode_index"]
    for key, value in row.items():
        kind = int | float if key.endswith("from_timestamp") else int
        if key != "tasks" and not (isinstance(value, kind) and (key == "length") <= value < 2**31):
            raise RecordingError(
                f"{folder}: {key} of episode {number} is {value!r} in meta/episodes; that is impossible"
            )
    table = inside(folder, info.data_path, row["data/chunk_index"], row["data/file_index"])
    videos = {}
    for camera, (key, _, _) in info.cameras.items():
        at = f"videos/{key}"
        path = inside(folder, info.video_path, row[f"{at}/chunk_index"], row[f"{at}/file_index"], key)
        videos[camera] = (path, float(row[f"{at}/from_timestamp"]))
    for path in (table, *(path for path, _ in videos.values())):
        if not path.is_file():
            raise RecordingError(f"{path}, which holds episode {number}, is missing; copy the whole set again")
    tasks = row["tasks"]
    task = tasks[0] if isinstance(tasks, list) and tasks else tasks
    return LeRobotEpisode(number, int(row["length"]), str(task or ""), table, videos, info, reader)


def _check_size(metadata: Any, columns: list[str], path: Path) -> None:
    """Raises: RecordingError for a table whose columns claim more than can be read."""
    numbers = sum(
        group.column(i).num_values
        for group in map(metadata.row_group, range(metadata.num_row_groups))
        for i in range(metadata.num_columns)
        if any(group.column(i).path_in_schema.startswith(name) for name in columns)
    )
    if max(numbers, metadata.num_rows) > MAX_NUMBERS:
        raise RecordingError(f"{path}: it claims {numbers} numbers; at most {MAX_NUMBERS} are read")


def _sizes(column: Any) -> list[int]:
    """Lengths of the lists of a column."""
    size = getattr(column.type, "list_size", None)
    return [size] if size is not None else [len(row) for row in column.to_pylist()]
