"""Episodes as ALOHA and AgileX HDF5 files: all that their loaders index, and more where it is known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.recordings import hdf5
from embodiedreamer_gym.recordings.episodes.aloha import CLASSES
from embodiedreamer_gym.recordings.episodes.episode_set import Frames, check_frame, check_numbers, frame_rows

PACKING = {"raw": {}, "gzip": {"compression": "gzip", "compression_opts": 1}, "jpeg": {}}
MASK_PACKING = {"compression": "gzip", "compression_opts": 4}
BASE = 2  # columns of /base_action, which AgileX's loader reads; zeros for a robot that does not drive
JPEG_STEP = 4096  # bytes by which the rows of JPEG buffers grow


@renamed_arguments(rate="hz")
class AlohaWriter:
    """Writes `episode_0.hdf5`, `episode_1.hdf5`, … into a folder; each is there when it is whole, and not before.

    hz: control rate, Hz; images: raw as the robots' own scripts write them, gzip (smaller, the same to every reader) or
    jpeg; attributes: of each file, what is no text or number becomes JSON. Frames are taken one at a time.
    Raises: RecordingError for other images, or a folder that cannot be made or holds episodes already.
    """

    def __init__(self, folder: str | Path, hz: float, images: str = "raw", **attributes: Any) -> None:
        if images not in PACKING:
            raise RecordingError(f"images {images!r} is not one of {', '.join(PACKING)}")
        self.folder, self.hz, self.images, self.attributes = Path(folder), hz, images, attributes
        self._count = 0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f"{self.folder} cannot be written: {error.strerror or error}") from error
        if any(self.folder.glob("*.hdf5")):
            raise RecordingError(f"{self.folder} holds episodes already; give an empty folder")

    def __repr__(self) -> str:
        return f"AlohaWriter({str(self.folder)!r}, {self._count} episodes)"

    def __enter__(self) -> AlohaWriter:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def add_episode(
        self, states: np.ndarray, actions: np.ndarray, frames: Frames, task: str = "", **extras: Any
    ) -> None:
        """Write one episode; extras: further arguments of `write_aloha_episode`.

        states (T, n); actions (T, m); frames: camera -> T frames (H, W, 3) uint8, taken in turn, one of each camera.
        Raises: RecordingError where lengths disagree, a number is not finite or the file cannot be written.
        """
        path = self.folder / f"episode_{self._count}.hdf5"
        attributes = {**self.attributes, **extras.pop("attributes", {})}
        write_aloha_episode(
            path, states, actions, frames, task, hz=self.hz, images=self.images, attributes=attributes, **extras
        )
        self._count += 1

    def close(self) -> None:
        """Nothing is left to do: every episode is on disk."""


@renamed_arguments(rate="hz")
def write_aloha_episode(
    path: str | Path, states: np.ndarray, actions: np.ndarray, frames: Frames, task: str = "", *, hz: float,
    images: str = "raw", velocities: np.ndarray | None = None, efforts: np.ndarray | None = None,
    objects: Mapping[str, np.ndarray] | None = None, masks: Frames | None = None, classes: Sequence[str] = (),
    attributes: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write one episode beside its place, a frame at a time, and rename it when it is whole.

    hz: control rate, Hz; velocities, efforts (T, n): zeros where None, as loaders index them; objects: name -> poses (T, 7),
    position m and quaternion xyzw, as `/objects/<name>`; masks: camera -> T masks (H, W) uint8 of its frames, whose numbers
    `classes` names; task: a sentence, the attribute `instruction`; images, attributes: as of AlohaWriter.
    Raises: RecordingError where lengths disagree, a number is not finite or the file cannot be written.
    """
    states, actions = check_numbers(np.asarray(states), "states"), check_numbers(np.asarray(actions), "actions")
    zeros, count = np.zeros_like(states), len(states)
    arrays = {
        hdf5.POSITION: states, hdf5.COMMAND: actions, "base_action": np.zeros((count, BASE), np.float32),
        hdf5.VELOCITY: zeros if velocities is None else velocities,
        hdf5.EFFORT: zeros if efforts is None else efforts,
        **{f"objects/{name}": poses for name, poses in (objects or {}).items()},
    }  # fmt: skip
    with hdf5.new_hdf5(path) as file:
        for key, array in arrays.items():
            if len(array) != count:
                raise RecordingError(f"{path}: /{key} has {len(array)} steps for {count} states")
            file[key] = array
        rows = _image_rows(frames, count, str(path))
        if images == "jpeg":
            _write_jpegs(file, count, rows)
        else:
            hdf5.write_rows(file, count, rows, lambda key: PACKING[images])
        for camera, source in (masks or {}).items():
            key = f"{hdf5.MASKS}/{camera}"
            mask_rows = ({key: row[camera]} for row in frame_rows({camera: source}, count, str(path)))
            hdf5.write_rows(file, count, mask_rows, lambda key: MASK_PACKING)
        if masks:
            hdf5.write_attributes(file, {CLASSES: list(classes)})
        file.attrs.update({"sim": True, "compress": images == "jpeg", "rate": float(hz), "instruction": task})
        hdf5.write_attributes(file, attributes or {})


def _image_rows(frames: Frames, count: int, where: str) -> Iterator[dict[str, np.ndarray]]:
    """One frame of each camera at a time, by dataset.

    Raises: RecordingError for frames of another kind, several sizes, or another number.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    for row in frame_rows(frames, count, where):
        for camera, frame in row.items():
            check_frame(frame, shapes.setdefault(camera, frame.shape), f"{where}: camera {camera}")
        yield {f"{hdf5.IMAGES}/{camera}": frame for camera, frame in row.items()}


def _write_jpegs(file: h5py.File, count: int, rows: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Frames as JPEG buffers that are zero-padded to the longest; `/compress_len` (cameras, T) holds their lengths."""
    lengths: list[list[int]] = []
    for step, row in enumerate(rows):
        lengths.append([])
        for key, frame in row.items():
            code = hdf5.jpeg(frame)
            if key not in file:
                file.create_dataset(key, (count, JPEG_STEP), np.uint8, chunks=(1, JPEG_STEP), maxshape=(count, None))
            data: Any = file[key]
            if code.size > data.shape[1]:
                data.resize(-(-code.size // JPEG_STEP) * JPEG_STEP, axis=1)
            data[step, : code.size] = code
            lengths[-1].append(code.size)
    if lengths and lengths[0]:
        file["compress_len"] = np.array(lengths).T
