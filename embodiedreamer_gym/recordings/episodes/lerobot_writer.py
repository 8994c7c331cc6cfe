"""Episodes as a LeRobot v3 folder, as LeRobot 0.4 to 0.6 writes it.

Source: lerobot/datasets (dataset_writer.py, dataset_metadata.py, utils.py, video_utils.py) of huggingface/lerobot 0.6.1.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.recordings.episodes.episode_set import ACTION, STATE, Frames, check_numbers, frame_rows
from embodiedreamer_gym.recordings.episodes.lerobot_info import IMAGES, VERSION
from embodiedreamer_gym.recordings.episodes.lerobot_tables import Tables, write_tasks
from embodiedreamer_gym.recordings.episodes.lerobot_videos import CHUNK, FILES, VIDEO_MB, VIDEO_PATH, CameraVideos
from embodiedreamer_gym.recordings.episodes.statistics import Statistics, combine_statistics, number_statistics
from embodiedreamer_gym.recordings.episodes.video import check_video

ABOUT = "meta/embodiedreamer.json"  # ignored by LeRobot
DATA_PATH = f"data/{FILES}.parquet"
DATA_MB = 100  # of a file, before the next one is begun
INDEX: dict[str, Any] = {
    key: {"dtype": kind, "shape": [1], "names": None}
    for key, kind in (("timestamp", "float32"), *((k, "int64") for k in ("frame_index", "episode_index", "index", "task_index")))
}  # fmt: skip


@renamed_arguments(rate="hz")
class LeRobotWriter:
    """Writes a LeRobot v3 folder, which exists once it is closed, and not before; use it in a `with` statement.

    hz: control rate, a whole number; joints: names of the numbers of state and action; codec: libx264 or libsvtav1
    (LeRobot's own); about: more about the set, as JSON in meta/embodiedreamer.json. Frames are taken one at a time; one
    video of each camera continues through the episodes.
    Raises: RecordingError for a folder that exists already, or an impossible rate or codec; MissingExtraError without
    pyarrow or av.
    """

    def __init__(self, folder: str | Path, hz: float, joints: Sequence[str] = (), codec: str = "libx264",
                 robot_type: str | None = None, about: Mapping[str, Any] | None = None) -> None:  # fmt: skip
        self.folder = Path(folder)
        if self.folder.exists():
            raise RecordingError(
                f"{self.folder} exists already; a LeRobot set is written as a whole, so give another folder"
            )
        if not 0 < hz < 1e6 or hz != int(hz):
            raise RecordingError(f"a LeRobot set needs a whole number of Hz, not {hz:g}")
        check_video((2, 2), codec)
        self.hz, self._joints, self._codec, self._robot = int(hz), list(joints), codec, robot_type
        self._part = self.folder.with_name(f".{self.folder.name}.part")
        shutil.rmtree(self._part, ignore_errors=True)  # of a run that was interrupted
        self._tables = Tables(self._part, DATA_PATH, DATA_MB, CHUNK)
        self._videos: dict[str, CameraVideos] = {}
        self._tasks: dict[str, int] = {}
        self._statistics: dict[str, list[Statistics]] = {}
        self._sizes: tuple[int, int] | None = None
        self._about = about

    def __repr__(self) -> str:
        return f"LeRobotWriter({str(self.folder)!r}, {self._tables.episodes} episodes)"

    def __enter__(self) -> LeRobotWriter:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self.close()
        else:
            self._stop()

    def add_episode(self, states: np.ndarray, actions: np.ndarray, frames: Frames,
                    task: str = "", **extras: Any) -> None:  # fmt: skip
        """Write one episode; extras are for other writers, and ignored.

        states (T, n); actions (T, m); frames: camera -> T frames (H, W, 3) uint8, taken in turn, one of each camera.
        Raises: RecordingError where lengths or sizes disagree, a number is not finite or the disk is full; nothing of
        the set is kept then.
        """
        try:
            self._add(
                check_numbers(np.asarray(states), "states"), check_numbers(np.asarray(actions), "actions"), frames, task
            )
        except BaseException as error:
            self._stop()
            if isinstance(error, OSError):
                raise RecordingError(f"{self.folder} cannot be written: {error.strerror or error}") from error
            raise

    def close(self) -> None:
        """Write the files of meta/, and move the folder to its place.

        Raises: RecordingError where there is no episode.
        """
        try:
            if self._tables.episodes == 0:
                raise RecordingError(f"{self.folder}: there is no episode to write")
            self._tables.close()
            for video in self._videos.values():
                video.close()
            write_tasks(self._part / "meta" / "tasks.parquet", list(self._tasks))
            total = {key: combine_statistics(parts) for key, parts in self._statistics.items()}
            _write_json(self._part / "meta" / "stats.json", {k: _plain(v) for k, v in total.items()})
            _write_json(self._part / "meta" / "info.json", self._info())
            if self._about is not None:
                _write_json(self._part / ABOUT, self._about)
            self._part.replace(self.folder)
        except OSError as error:
            raise RecordingError(f"{self.folder} cannot be written: {error.strerror or error}") from error
        finally:
            self._stop()

    def _stop(self) -> None:
        """Close all files and remove the unfinished folder."""
        self._tables.close()
        for video in self._videos.values():
            video.close()
        shutil.rmtree(self._part, ignore_errors=True)

    def _add(self, states: np.ndarray, actions: np.ndarray, frames: Frames, task: str) -> None:
        length = len(states)
        if length == 0 or len(actions) != length:
            raise RecordingError(f"{self.folder}: {length} states and {len(actions)} actions; they must agree")
        if self._tables.episodes == 0:
            self._sizes = (states.shape[1], actions.shape[1])
            self._videos = {name: CameraVideos(self._part, IMAGES + name, self.hz, self._codec) for name in frames}
        if (states.shape[1], actions.shape[1]) != self._sizes or list(frames) != list(self._videos):
            raise RecordingError(
                f"{self.folder}: this episode has {states.shape[1]} states, {actions.shape[1]} actions and the cameras "
                f"{', '.join(frames)}, others have {self._sizes} and {', '.join(self._videos)}; all must have the same"
            )
        places = self._encode(frames, length)
        number, first = self._tables.episodes, self._tables.rows
        steps = np.arange(length)
        columns = {
            STATE: states, ACTION: actions, "timestamp": (steps / self.hz).astype(np.float32), "frame_index": steps,
            "episode_index": np.full(length, number), "index": first + steps,
            "task_index": np.full(length, self._tasks.setdefault(task, len(self._tasks))),
        }  # fmt: skip
        statistics = {key: number_statistics(values.reshape(length, -1)) for key, values in columns.items()}
        for video in self._videos.values():
            statistics[video.key] = video.statistics.result()
        for key, values in statistics.items():
            self._statistics.setdefault(key, []).append(values)
        stats = {f"stats/{key}/{name}": x for key, values in statistics.items() for name, x in _plain(values).items()}
        self._tables.add(columns, {"tasks": [task], **places}, stats)

    def _encode(self, frames: Frames, length: int) -> dict[str, Any]:
        """Encode an episode's frames, one of each camera in turn; columns that say in which video they are."""
        for camera in frames:
            self._videos[camera].begin(length)
        for step, row in enumerate(frame_rows(frames, length, str(self.folder))):
            for camera, frame in row.items():
                self._videos[camera].add(frame, step)
        return {key: value for video in self._videos.values() for key, value in video.place(length).items()}

    def _info(self) -> dict[str, Any]:
        """meta/info.json."""
        states, actions = self._sizes or (0, 0)
        features: dict[str, Any] = {}
        for key, size in ((STATE, states), (ACTION, actions)):
            names = self._joints if len(self._joints) == size else [f"{key.split('.')[-1]}_{i}" for i in range(size)]
            features[key] = {"dtype": "float32", "shape": [size], "names": names}
        features |= {video.key: video.feature() for video in self._videos.values()}
        return {
            "codebase_version": VERSION, "fps": self.hz, "features": features | INDEX,
            "total_episodes": self._tables.episodes, "total_frames": self._tables.rows, "total_tasks": len(self._tasks),
            "chunks_size": CHUNK, "data_files_size_in_mb": DATA_MB, "video_files_size_in_mb": VIDEO_MB,
            "data_path": DATA_PATH, "video_path": VIDEO_PATH if self._videos else None, "robot_type": self._robot,
            "splits": {"train": f"0:{self._tables.episodes}"},
        }  # fmt: skip


def _plain(statistics: Statistics) -> dict[str, Any]:
    return {name: value.tolist() for name, value in statistics.items()}


def _write_json(path: Path, data: Any) -> None:
    path.write_text(json.dumps(data, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")
