"""Episodes as ALOHA and AgileX HDF5 files: what their loaders index is there, and more where it is known."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import h5py
import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.aloha import ACTION, CLASSES, IMAGES, MASKS, STATE
from embodiedreamer_gym.recordings.episodes.episode_set import check_numbers

IMAGE_FORMS = ("raw", "gzip", "jpeg")
QUALITY = 95  # of JPEG
BASE = 2  # columns of /base_action, which AgileX's loader reads; zeros for a robot that stands
ROOM = 4096  # bytes by which the room of a JPEG grows
Frames = Mapping[str, Iterable[np.ndarray]]


class AlohaWriter:
    """Writes `episode_0.hdf5`, `episode_1.hdf5`, … into a folder; each is there when it is whole, and not before.

    rate: Hz; images: raw as the robots' own scripts write them, gzip (smaller, the same to every reader) or jpeg;
    attributes: of each file, what is no text or number becomes JSON. Frames are taken one at a time.
    Raises: RecordingError for other images, or a folder that cannot be made or holds episodes already.
    """

    def __init__(self, folder: str | Path, rate: float, images: str = "raw", **attributes: Any) -> None:
        if images not in IMAGE_FORMS:
            raise RecordingError(f"images {images!r} is none of {', '.join(IMAGE_FORMS)}")
        self.folder, self.rate, self.images, self.attributes = Path(folder), rate, images, attributes
        self._count = 0
        with _written(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
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
        """Write one episode; as `write_aloha_episode`, whose extras these are.

        states (T, n); actions (T, m); frames: camera -> T frames (H, W, 3) uint8, taken in turn, one of each camera.
        Raises: RecordingError where lengths disagree, a number is not finite or the file cannot be written.
        """
        path = self.folder / f"episode_{self._count}.hdf5"
        attributes = {**self.attributes, **extras.pop("attributes", {})}
        write_aloha_episode(
            path, states, actions, frames, task, rate=self.rate, images=self.images, attributes=attributes, **extras
        )
        self._count += 1

    def close(self) -> None:
        """Nothing is left to do: every episode is on disk."""


def write_aloha_episode(
    path: str | Path, states: np.ndarray, actions: np.ndarray, frames: Frames, task: str = "", *, rate: float,
    images: str = "raw", velocities: np.ndarray | None = None, efforts: np.ndarray | None = None,
    objects: Mapping[str, np.ndarray] | None = None, masks: Frames | None = None, classes: Sequence[str] = (),
    attributes: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write one episode beside its place, a frame at a time, and rename it when it is whole.

    velocities, efforts (T, n): zeros where None, as loaders index them; objects: name -> poses (T, 7), position m and
    quaternion xyzw, as `/objects/<name>`; masks: camera -> T masks (H, W) uint8 of its frames, whose numbers `classes` names;
    task: a sentence, the attribute `instruction`.
    Raises: RecordingError where lengths disagree, a number is not finite or the file cannot be written.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.part")
    states, actions = check_numbers(np.asarray(states), "states"), check_numbers(np.asarray(actions), "actions")
    rest = np.zeros_like(states)
    arrays = {
        STATE: states, ACTION: actions, "base_action": np.zeros((len(states), BASE), np.float32),
        "observations/qvel": rest if velocities is None else velocities,
        "observations/effort": rest if efforts is None else efforts,
        **{f"objects/{name}": poses for name, poses in (objects or {}).items()},
    }  # fmt: skip
    with _written(path):
        try:
            with h5py.File(part, "w") as file:
                for key, array in arrays.items():
                    if len(array) != len(states):
                        raise RecordingError(f"{path}: /{key} has {len(array)} steps for {len(states)} states")
                    file[key] = array
                _write_frames(file, path, frames, len(states), images)
                _write_masks(file, path, masks or {}, len(states))
                if masks:
                    file.attrs[CLASSES] = json.dumps(list(classes))
                file.attrs.update({"sim": True, "compress": images == "jpeg", "rate": float(rate), "instruction": task})
                for key, value in (attributes or {}).items():
                    file.attrs[key] = json.dumps(value) if isinstance(value, dict | list | tuple) else value
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


def _write_frames(file: h5py.File, path: Path, frames: Frames, length: int, images: str) -> None:
    """Take the cameras' frames in turn, each as often as there are steps."""
    sizes: list[list[int]] = []
    rooms: dict[str, h5py.Dataset] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    sources = {camera: iter(source) for camera, source in frames.items()}
    for step in range(length):
        sizes.append([])
        for camera, source in sources.items():
            frame = np.asarray(_next(source, path, camera, step, length))
            if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
                raise RecordingError(f"{path}: a frame of {camera} is {frame.dtype} of shape {frame.shape}; "
                                     "(H, W, 3) uint8 is expected")  # fmt: skip
            if frame.shape != shapes.setdefault(camera, frame.shape):
                raise RecordingError(f"{path}: frames of {camera} have several sizes; all must have one")
            if camera not in rooms:
                rooms[camera] = _room(file, f"{IMAGES}/{camera}", length, frame, images)
            sizes[-1].append(_put(rooms[camera], step, frame, images))
    for camera, source in sources.items():
        if next(source, None) is not None:
            raise RecordingError(f"{path}: camera {camera} has more than {length} frames, one per step")
    if images == "jpeg" and rooms:
        file["compress_len"] = np.array(sizes).T


def _write_masks(file: h5py.File, path: Path, masks: Frames, length: int) -> None:
    """Masks of each camera, packed."""
    for camera, source in masks.items():
        room, rows = None, iter(source)
        for step in range(length):
            mask = np.asarray(_next(rows, path, camera, step, length))
            if room is None:
                room = file.create_dataset(f"{MASKS}/{camera}", (length, *mask.shape), np.uint8, chunks=(1, *mask.shape),
                                           compression="gzip", compression_opts=4)  # fmt: skip
            room[step] = mask


def _next(source: Iterator[np.ndarray], path: Path, camera: str, step: int, length: int) -> np.ndarray:
    frame = next(source, None)
    if frame is None:
        raise RecordingError(f"{path}: camera {camera} has {step} frames for {length} steps; frames are missing")
    return frame


def _room(file: h5py.File, key: str, length: int, frame: np.ndarray, images: str) -> h5py.Dataset:
    """Room for the frames of one camera."""
    if images == "jpeg":
        return file.create_dataset(key, (length, ROOM), np.uint8, chunks=(1, ROOM), maxshape=(length, None))
    packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1} if images == "gzip" else {}
    return file.create_dataset(key, (length, *frame.shape), np.uint8, chunks=(1, *frame.shape), **packed)


def _put(room: h5py.Dataset, step: int, frame: np.ndarray, images: str) -> int:
    """Write a frame; bytes of its JPEG, 0 where it is none."""
    if images != "jpeg":
        room[step] = frame
        return 0
    _, code = cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if code.size > room.shape[1]:
        room.resize(-(-code.size // ROOM) * ROOM, axis=1)  # zeros up to the longest
    room[step, : code.size] = code.ravel()
    return int(code.size)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """Complain in one sentence where something cannot be written."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror or error}") from error
