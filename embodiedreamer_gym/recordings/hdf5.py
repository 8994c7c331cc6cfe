"""HDF5 files in the ALOHA layout: datasets are checked before they are read, files are written atomically.

The published layout: `/action`, `/observations/qpos`, `qvel`, `effort` and `images/<camera>`, one file per motion.
Source: collect_data.py of agilexrobotics/cobot_magic and record_episodes.py of tonyzhaozh/aloha.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.recordings.frames import MAX_EDGE, decode
from embodiedreamer_gym.recordings.time_axis import check_hz, find_clock

POSITION, COMMAND = "observations/qpos", "action"
VELOCITY, EFFORT = "observations/qvel", "observations/effort"
IMAGES, MASKS = "observations/images", "observations/masks"
SUFFIXES = (".hdf5", ".h5")
MAX_NUMBERS = 10_000_000  # of one signal: 14 joints at 100 Hz for two hours
MAX_BYTES = 2**30  # bytes read into memory while a file is open
MAX_CHUNK_BYTES = 2**29  # bytes of a chunk or row, which HDF5 decompresses as a whole
HZ_ATTRIBUTES = ("rate", "fps", "control_hz")
LAYOUT_FLAGS = {"sim": False, "compress": False}  # attributes that ACT's loader requires


class Hdf5File:
    """An open HDF5 file. Every dataset is checked (kind, place, claimed size) before it is read.

    file: the h5py file; path: path of the file, for messages.
    """

    def __init__(self, file: h5py.File, path: Path) -> None:
        self.file, self.path, self._bytes = file, path, 0

    def __contains__(self, key: str) -> bool:
        return key in self.file

    def error(self, text: str) -> RecordingError:
        """An error that names the file."""
        return RecordingError(f"{self.path}: {text}")

    def dataset(self, key: str) -> h5py.Dataset:
        """A dataset stored in this file itself, in chunks that fit into memory.

        Raises: RecordingError where it is missing, a group, empty, linked to another file or in chunks that are too
        large.
        """
        data = self.file.get(key)
        if isinstance(data, h5py.Group):
            raise self.error(f"/{key} is a group, but a dataset is expected")
        if not isinstance(data, h5py.Dataset) or data.shape is None:
            raise self.error(f"the dataset /{key} is missing; the file has {self._contents()}")
        if data.file.filename != self.file.filename or data.external or data.is_virtual:
            raise self.error(f"/{key} points to another file; copy its numbers into this one")
        chunk = data.chunks or data.shape[1:]
        if max(math.prod(chunk), math.prod(data.shape[1:])) * data.dtype.itemsize > MAX_CHUNK_BYTES:
            raise self.error(f"/{key} claims the shape {data.shape} in chunks of {chunk}, more than fits into memory")
        return data

    def read(self, key: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Rows start .. stop - 1 of a dataset of numbers.

        Raises: RecordingError for other types, and where all reads from this file together would exceed MAX_BYTES.
        """
        data = self.dataset(key)
        if data.dtype.kind not in "biufc":
            raise self.error(f"/{key} is {data.dtype} of shape {data.shape}; numbers are expected")
        rows = range(data.shape[0] if data.shape else 1)[start:stop]
        self.reserve(key, len(rows) * math.prod(data.shape[1:]) * data.dtype.itemsize)
        return np.asarray(data[rows.start : rows.stop] if data.shape else data[()])

    def reserve(self, key: str, count: int) -> None:
        """Add to the bytes read from this file so far. Raises: RecordingError where the total exceeds MAX_BYTES."""
        self._bytes += count
        if self._bytes > MAX_BYTES:
            raise self.error(
                f"/{key} claims {count / 2**30:.1f} GB; at most {MAX_BYTES / 2**30:.1f} GB of a file are read at once"
            )

    def signal(self, key: str) -> np.ndarray:
        """A signal (T, n) of real numbers, as stored.

        Raises: RecordingError for another type or shape, or more than MAX_NUMBERS numbers.
        """
        data = self.dataset(key)
        if data.ndim != 2 or data.dtype.kind not in "iuf":
            raise self.error(f"/{key} is {data.dtype} of shape {data.shape}; numbers of shape (T, n) are expected")
        if math.prod(data.shape) > MAX_NUMBERS:
            raise self.error(f"/{key} claims the shape {data.shape}; at most {MAX_NUMBERS} numbers are read")
        return self.read(key)

    def times(self, position: np.ndarray, unit: str | None = None) -> tuple[np.ndarray, tuple[str, ...]] | None:
        """Time stamps (T,) in s and notes about their conversion; None where the file has none.

        position: (T, n), used to infer the unit; unit: unit of the stamps, if the caller knows it.
        Raises: RecordingError where there are not T numbers, or their unit cannot be inferred.
        """
        key = next((key for key in ("timestamps", "timestamp") if key in self.file), None)
        if key is None:
            return None
        data = self.dataset(key)
        if data.size != len(position) or data.dtype.kind not in "iuf":
            raise self.error(f"/{key} has {data.size} times ({data.dtype}) for {len(position)} rows of /{POSITION}")
        stated = data.attrs.get("units", data.attrs.get("unit"))
        stamps = self.read(key).ravel()
        clock = find_clock(stamps, position, str(self.path), unit, None if stated is None else text(stated))
        return clock.seconds(stamps), clock.notes

    def hz(self) -> float | None:
        """The sampling rate that an attribute states, Hz.

        Raises: RecordingError where it is not a valid rate.
        """
        values: list[Any] = [self.file.attrs[name] for name in HZ_ATTRIBUTES if name in self.file.attrs]
        return (
            check_hz(values[0] if np.size(values[0]) != 1 else np.ravel(values[0])[0], str(self.path))
            if values
            else None
        )

    def json(self, name: str, default: Any = None) -> Any:
        """The value of an attribute that holds JSON; `default` where the attribute is missing.

        Raises: RecordingError where it does not hold JSON.
        """
        if name not in self.file.attrs:
            return default
        try:
            return json.loads(text(self.file.attrs[name]))
        except (ValueError, RecursionError) as error:
            raise self.error(f"the attribute {name} is neither a list of strings nor JSON") from error

    def strings(self, name: str) -> tuple[str, ...]:
        """An attribute that is an array of strings, or a JSON list; () where it is missing.

        Raises: RecordingError where it is neither.
        """
        value = self.file.attrs.get(name, ())
        if isinstance(value, str | bytes):
            value = self.json(name)
        if not isinstance(value, list | tuple | np.ndarray) or np.ndim(np.array(value, object)) != 1:
            raise self.error(f"the attribute {name} must be a list of strings")
        return tuple(text(item) for item in value)

    def cameras(self) -> dict[str, h5py.Dataset]:
        """The frames of each camera: raw (T, H, W, 3) uint8, or one JPEG per row.

        Raises: RecordingError for a dataset of another form, or frames larger than MAX_EDGE.
        """
        group = self.file.get(IMAGES)
        if group is not None and not isinstance(group, h5py.Group):
            raise self.error(f"/{IMAGES} is not a group with one dataset per camera")
        cameras = {}
        for name in group or ():
            key = f"{IMAGES}/{name}"
            data = cameras[str(name)] = self.dataset(key)
            raw = data.ndim == 4 and data.shape[3] == 3 and data.dtype == np.uint8
            buffers = data.ndim == 2 and data.dtype == np.uint8
            if not (raw or buffers or (data.ndim == 1 and h5py.check_vlen_dtype(data.dtype) == np.uint8)):
                raise self.error(f"/{key} is {data.dtype} of shape {data.shape}; "
                                 "uint8 (T, H, W, 3) or one JPEG per row is expected")  # fmt: skip
            if raw and not 0 < min(data.shape[1:]) <= max(data.shape[1:]) <= MAX_EDGE:
                raise self.error(f"/{key} has frames of {data.shape[2]} x {data.shape[1]}; 1 to {MAX_EDGE} are allowed")
        return cameras

    def frames(self, camera: str, start: int, stop: int) -> Iterator[np.ndarray]:
        """Frames start .. stop - 1 of a camera, (H, W, 3) uint8 RGB, one after another.

        Raises: RecordingError where a row is not an image.
        """
        key = f"{IMAGES}/{camera}"
        data = self.dataset(key)
        for index in range(start, stop):
            row = np.asarray(data[index])
            yield row if row.ndim == 3 else decode(row, f"{self.path}: frame {index} of /{key}")

    def object_poses(self) -> dict[str, np.ndarray]:
        """Poses (T, 7) of each object in `/objects/<name>`: position m and quaternion xyzw; {} if there are none.

        Raises: RecordingError where a dataset does not hold poses.
        """
        group = self.file.get("objects")
        names = [str(name) for name in group] if isinstance(group, h5py.Group) else []
        poses = {name: self.signal(f"objects/{name}") for name in names}
        for name, rows in poses.items():
            if rows.shape[1] != 7 or not len(rows) or not np.isfinite(rows[0]).all():
                raise self.error(f"/objects/{name} holds no poses (T, 7), position m and quaternion xyzw")
        return poses

    def _contents(self) -> str:
        names: list[str] = []
        self.file.visititems(lambda name, node: names.append(f"/{name}") if isinstance(node, h5py.Dataset) else None)
        return ", ".join(names[:12]) or "no dataset at all"


@contextmanager
def open_hdf5(
    path: str | Path, error: type[EmbodieDreamerError] = RecordingError, advice: str = "record or copy it again"
) -> Iterator[Hdf5File]:
    """Open an HDF5 file for reading; errors of h5py inside the block become an `error` with a one-sentence message.

    error: class of the error; advice: what to do about a damaged file.
    Raises: `error` where the file is missing, damaged or not of the layout; the file's name is added to errors raised
    in the block.
    """
    path = Path(path)
    if not path.is_file():
        raise error(f"{path}: there is no such file")
    try:
        with h5py.File(path, "r") as file:
            yield Hdf5File(file, path)
    except EmbodieDreamerError as reason:
        if isinstance(reason, error) and str(path) in str(reason):
            raise
        raise error(f"{path}: {reason}" if str(path) not in str(reason) else str(reason)) from reason
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError, OverflowError) as reason:
        raise error(f"{path}: damaged, cut short or not an HDF5 file; {advice}") from reason


@contextmanager
def new_hdf5(path: str | Path, error: type[EmbodieDreamerError] = RecordingError) -> Iterator[h5py.File]:
    """Open an HDF5 file for writing; it gets its name only when the block has ended without an exception.

    Raises: `error` where it cannot be written.
    """
    with atomic_file(path, error) as part, h5py.File(part, "w") as file:
        yield file


def read_settings(path: Path, attribute: str, what: str) -> dict[str, Any]:
    """The settings that a file was made with, a JSON object in an attribute; what: the kind of file, for the message.

    Raises: RecordingError where the file is not of that kind.
    """
    try:
        with open_hdf5(path) as file:
            return dict(file.json(attribute))
    except (RecordingError, TypeError, ValueError) as error:
        raise RecordingError(f"{path} exists already and is not a {what}; give another folder.") from error


def write_rows(
    file: h5py.File, count: int, rows: Iterable[Mapping[str, np.ndarray]],
    packing: Callable[[str], Mapping[str, Any]] = lambda key: {},
) -> None:  # fmt: skip
    """Write the rows of several datasets one by one, one chunk per row.

    count: number of rows; rows: dataset -> row, whose shape and dtype stay the same; packing: returns the compression
    of a dataset as arguments of h5py's create_dataset.
    """
    for index, row in enumerate(rows):
        for key, array in row.items():
            if key not in file:
                shape = (count, *array.shape)
                file.create_dataset(key, shape, array.dtype, chunks=(1, *array.shape), **packing(key))
            file[key][index] = array  # pyright: ignore[reportIndexIssue]


def write_attributes(file: h5py.File, attributes: Mapping[str, Any], arrays: tuple[str, ...] = ()) -> None:
    """Write attributes; lists, tuples and dicts become JSON, except those named in `arrays`, which become arrays."""
    for name, value in attributes.items():
        is_json = isinstance(value, dict | list | tuple) and name not in arrays
        file.attrs[name] = json.dumps(value) if is_json else value


def jpeg(frame: np.ndarray, quality: int = 95) -> np.ndarray:
    """A frame (H, W, 3) uint8 RGB as the bytes (L,) uint8 of a JPEG."""
    return cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])[1].ravel()


def text(value: Any) -> str:
    """An attribute as text; bytes are decoded."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
