"""The parquet tables of a LeRobot set: the data, one group of rows per episode, and a table of the episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.recordings.extras import load_extra

EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
BUFFERED = 50  # rows of the table of episodes that are kept in memory before they are written


class Tables:
    """Writes rows of data, and beside them one row for each episode.

    data_path: template of a path below the folder; most: megabytes of a file; chunk: files of a folder.
    """

    def __init__(self, folder: Path, data_path: str, most: int, chunk: int) -> None:
        self._arrow, self._parquet = load_extra("pyarrow"), load_extra("pyarrow.parquet")
        self._folder, self._path, self._most, self._chunk = folder, data_path, most, chunk
        self._file, self._first = 0, 0  # number of the data file, and its first row
        self._data: Any = None
        self._episodes_file: Any = None
        self._rows_to_write: list[dict[str, Any]] = []
        self.episodes, self.rows = 0, 0

    def add(self, columns: dict[str, np.ndarray], description: dict[str, Any], statistics: dict[str, Any]) -> None:
        """Write an episode's columns (T,) or (T, n), and keep its row of the table of episodes."""
        table = self._arrow.table({key: self._column(values) for key, values in columns.items()})
        self._next_file(table.num_rows)
        if self._data is None:
            path = self._folder / self._path.format(
                chunk_index=self._file // self._chunk, file_index=self._file % self._chunk
            )
            path.parent.mkdir(parents=True, exist_ok=True)
            self._data = self._parquet.ParquetWriter(path, table.schema, compression="snappy")
            self._data_path = path
        self._data.write_table(table)
        self._rows_to_write.append({
            "episode_index": self.episodes, **description, "length": table.num_rows,
            "data/chunk_index": self._file // self._chunk, "data/file_index": self._file % self._chunk,
            "dataset_from_index": self.rows, "dataset_to_index": self.rows + table.num_rows,
            **statistics, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        })  # fmt: skip
        self.episodes, self.rows = self.episodes + 1, self.rows + table.num_rows
        if len(self._rows_to_write) >= BUFFERED:
            self._write_episodes()

    def close(self) -> None:
        """Write the rows that are still in memory; a second call does nothing."""
        if self._rows_to_write:
            self._write_episodes()
        for writer in (self._data, self._episodes_file):
            if writer is not None:
                writer.close()
        self._data = self._episodes_file = None

    def _next_file(self, rows: int) -> None:
        """Begin the next file where this one would become too large."""
        if self._data is None:
            return
        megabytes = self._data_path.stat().st_size / 2**20
        if megabytes * (1.0 + rows / max(self.rows - self._first, 1)) >= self._most:
            self._data.close()
            self._data, self._file, self._first = None, self._file + 1, self.rows

    def _column(self, values: np.ndarray) -> Any:
        """An array (T,), or lists of fixed size of one (T, n)."""
        flat = self._arrow.array(np.ascontiguousarray(values).ravel())
        return flat if values.ndim == 1 else self._arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])

    def _write_episodes(self) -> None:
        """Write the rows of the table of episodes."""
        if self._episodes_file is None:
            path = self._folder / EPISODES_PATH.format(chunk_index=0, file_index=0)
            path.parent.mkdir(parents=True, exist_ok=True)
            table = self._arrow.Table.from_pylist(self._rows_to_write)
            self._episodes_file = self._parquet.ParquetWriter(path, table.schema, compression="snappy")
        else:
            table = self._arrow.Table.from_pylist(self._rows_to_write, schema=self._episodes_file.schema)
        self._episodes_file.write_table(table)
        self._rows_to_write = []


def write_tasks(path: Path, tasks: list[str]) -> None:
    """Write the tasks as pandas writes a frame with the index "task", so that it is one when LeRobot reads it."""
    arrow = load_extra("pyarrow")
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = [("task_index", "int64", "int64"), ("task", "unicode", "object")]
    pandas = {
        "index_columns": ["task"], "column_indexes": [],
        "columns": [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, kind, numpy in columns
        ],
        "creator": {"library": "pyarrow", "version": arrow.__version__}, "pandas_version": "2.2.0",
    }  # fmt: skip
    table = arrow.table({"task_index": arrow.array(range(len(tasks)), arrow.int64()), "task": tasks})
    table = table.replace_schema_metadata({"pandas": json.dumps(pandas)})
    load_extra("pyarrow.parquet").write_table(table, path)
