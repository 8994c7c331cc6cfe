"""Episodes of a LeRobot v3 folder: numbers in parquet tables, frames in videos.

Source: lerobot/datasets (dataset_metadata.py, dataset_reader.py) of huggingface/lerobot 0.6.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.episode_set import EpisodeSet, check_numbers
from embodiedreamer_gym.recordings.episodes.extras import load_extra
from embodiedreamer_gym.recordings.episodes.lerobot_info import ACTION, STATE, inside, read_info
from embodiedreamer_gym.recordings.episodes.video import VideoReader
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS


@dataclass(frozen=True)
class _Place:
    """Files of an episode: its table, and each camera's video with the second at which the episode begins."""

    length: int
    task: str
    table: Path
    videos: dict[str, tuple[Path, float]]


class LeRobotEpisodes(EpisodeSet):
    """Episodes of a LeRobot v3 folder; cameras are named without `observation.images.`.

    Raises: RecordingError where something is missing or does not fit; MissingExtraError without pyarrow or av.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder).absolute()  # a relative path might look like another protocol to ffmpeg
        self._info = info = read_info(self._folder)
        self._parquet, self._arrow = load_extra("pyarrow.parquet"), load_extra("pyarrow")
        self._videos = VideoReader() if info.cameras else None
        self._places = self._read_places()
        self.source = str(self._folder)
        self.cameras = tuple(info.cameras)
        self.state_size, self.action_size = info.state_size, info.action_size
        self.lengths = tuple(place.length for place in self._places)
        self.names = tuple(f"episode_{number}" for number in range(len(self._places)))
        if sum(self.lengths) != info.frames:
            raise RecordingError(
                f"{self.source}: the episodes have {sum(self.lengths)} steps, meta/info.json says {info.frames}"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {"folder": self._folder}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["folder"])

    @property
    def hz(self) -> float:
        """Steps per second, Hz."""
        return self._info.hz

    def task(self, episode: int) -> str:
        """The task in words."""
        return self._places[episode].task

    def states(self, episode: int) -> np.ndarray:
        """States (T, n), float32."""
        return self._numbers(episode, STATE, self.state_size)

    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m), float32."""
        return self._numbers(episode, ACTION, self.action_size)

    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""
        return self._info.cameras[camera][1:]

    def _read_frames(self, episode: int, camera: str, start: int, stop: int) -> np.ndarray:
        path, begin = self._places[episode].videos[camera]
        times = begin + np.arange(start, stop) / self.hz
        return self._videos.read(path, times, self.hz, self.frame_size(camera))  # pyright: ignore[reportOptionalMemberAccess]

    def _numbers(self, episode: int, key: str, width: int) -> np.ndarray:
        """One signal (T, width) of an episode."""
        place = self._places[episode]
        table = self._table(place.table, [key], [("episode_index", "=", episode)])
        column = table.column(key).combine_chunks()
        nested = hasattr(column.type, "value_type")
        flat = column.flatten() if nested else column
        if column.null_count or flat.null_count:
            raise RecordingError(f"{place.table}: {key} of episode {episode} has gaps; leave that episode out")
        if len(column) != place.length:
            raise RecordingError(
                f"{place.table}: episode {episode} has {len(column)} steps, but {place.length} in meta/episodes"
            )
        if len(flat) != width * place.length or (nested and set(_sizes(column)) != {width}):
            raise RecordingError(f"{place.table}: {key} has not {width} numbers a step, as meta/info.json says")
        values = flat.to_numpy(zero_copy_only=False).reshape(place.length, width)
        return check_numbers(values, f"{place.table}: {key} of episode {episode}")

    def _table(self, path: Path, columns: list[str], filters: Any = None) -> Any:
        """Columns of a table; whatever pyarrow finds wrong with it becomes one sentence. filters: of its rows."""
        try:
            with self._parquet.ParquetFile(path) as file:
                missing = [name for name in columns if name not in file.schema_arrow.names]
                if missing:
                    raise RecordingError(f"{path}: the column {missing[0]} is missing")
                _check_size(file.metadata, columns, path)
            return self._parquet.read_table(path, columns=columns, filters=filters, partitioning=None)
        except (self._arrow.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
            if isinstance(error, RecordingError):
                raise
            raise RecordingError(f"{path}: damaged, cut short or not a parquet table; copy it again") from error

    def _read_places(self) -> list[_Place]:
        """The files of all episodes, from meta/episodes."""
        paths = sorted((self._folder / "meta" / "episodes").glob("*/*.parquet"))
        videos = [key for key, _, _ in self._info.cameras.values()]
        columns = ["episode_index", "length", "tasks", "data/chunk_index", "data/file_index"]
        columns += [
            f"videos/{key}/{what}" for key in videos for what in ("chunk_index", "file_index", "from_timestamp")
        ]
        rows = [row for path in paths for row in self._table(path, columns).to_pylist()]
        if [row["episode_index"] for row in rows] != list(range(self._info.episodes)):
            raise RecordingError(
                f"{self._folder}: meta/episodes has {len(rows)} episodes, meta/info.json says {self._info.episodes}; "
                "they must be numbered from 0 without a gap"
            )
        return [self._place(row) for row in rows]

    def _place(self, row: dict[str, Any]) -> _Place:
        """The files of one episode, from its row of meta/episodes.

        Raises: RecordingError where one of them is missing, or a value is impossible.
        """
        info, number = self._info, row["episode_index"]
        for key, value in row.items():
            kind = int | float if key.endswith("from_timestamp") else int
            if key != "tasks" and not (isinstance(value, kind) and (key == "length") <= value < 2**31):
                raise RecordingError(
                    f"{self._folder}: {key} of episode {number} is {value!r} in meta/episodes; that is impossible"
                )
        table = inside(self._folder, info.data_path, row["data/chunk_index"], row["data/file_index"])
        videos = {}
        for camera, (key, _, _) in info.cameras.items():
            at = f"videos/{key}"
            path = inside(self._folder, info.video_path, row[f"{at}/chunk_index"], row[f"{at}/file_index"], key)
            videos[camera] = (path, float(row[f"{at}/from_timestamp"]))
        for path in (table, *(path for path, _ in videos.values())):
            if not path.is_file():
                raise RecordingError(f"{path} is missing, which holds episode {number}; copy the whole set again")
        tasks = row["tasks"]
        task = tasks[0] if isinstance(tasks, list) and tasks else tasks
        return _Place(int(row["length"]), str(task or ""), table, videos)


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
