"""ALOHA and AgileX logs: one HDF5 file a motion.

The published layout: `/action`, `/observations/qpos`, `qvel`, `effort` and `images/<camera>`. Beside it,
optional: `/timestamps` (T,) s, `/observations/usable` (T, n) and root attributes
`rate` or `fps` (Hz), `joint_names`, `units`, `noise`, `quantum`, `command_hold`, `kind`.
Source: collect_data.py of agilexrobotics/cobot_magic and record_episodes.py of tonyzhaozh/aloha.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.frames import FrameSource, Hdf5Frames
from embodiedreamer_gym.recordings.recording import Recording

ALOHA_JOINTS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in (*(f"joint{i}" for i in range(1, 7)), "gripper")
)
NORMALISED = (-0.2, 1.2)  # 0..1 and what a sensor's offset adds
_SIGNALS = {"command": "action", "velocity": "observations/qvel", "effort": "observations/effort"}
_POSITION = "observations/qpos"
_IMAGES = "observations/images"


def read_aloha_hdf5(path: str | Path, rate: float | None = None, joints: Iterable[str] | None = None) -> Recording:
    """Recording of an ALOHA-style HDF5 file; images stay in the file until a frame is asked for.

    rate: Hz, for files without `/timestamps`, in place of their attribute `rate`. joints: names, for files
    without them; else 14 columns get the ALOHA names and others joint1, joint2, …. Without the attribute
    `units` all joints are in rad, but of 14 joints the two grippers that stay within -0.2..1.2 in command and
    position are normalised, "1". Velocity or effort that is zero throughout counts as absent; a file without
    `/action` has no command.

    Raises: RecordingError where the file is missing, damaged or not of this layout.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    try:
        with h5py.File(path, "r") as file:
            return _read(file, path, rate, None if joints is None else tuple(joints))
    except RecordingError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:  # what h5py raises
        raise RecordingError(f"{path}: damaged, cut short or not an HDF5 file; record or copy it again") from error


def _read(file: h5py.File, path: Path, rate: float | None, joints: tuple[str, ...] | None) -> Recording:
    signals: dict[str, np.ndarray | None] = {"position": _signal(file, path, _POSITION)}
    position = signals["position"]
    if position is None:
        raise RecordingError(f"{path}: the dataset /{_POSITION} is missing; the file has {_contents(file)}")
    for name, key in _SIGNALS.items():
        array = _signal(file, path, key)
        if array is not None and array.shape != position.shape:
            raise RecordingError(
                f"{path}: /{key} has shape {array.shape}, /{_POSITION} {position.shape}; they must agree"
            )
        signals[name] = array if name == "command" or array is None or np.any(array) else None
    attributes = dict(file.attrs)
    given = _listed(attributes.get("joint_names"), path, "joint_names")
    names = tuple(str(joint) for joint in given) if given else joints or default_joints(position.shape[1])
    if len(names) != position.shape[1]:
        raise RecordingError(f"{path}: {len(names)} joint names for {position.shape[1]} columns of /{_POSITION}")
    optional: dict[str, Any] = {
        name: _text(attributes[name]) for name in ("command_hold", "kind") if name in attributes
    }
    for name in ("noise", "quantum"):
        if name in attributes:
            optional[name] = np.asarray(attributes[name], dtype=float)
    if "observations/usable" in file:
        optional["usable"] = _dataset(file, "observations/usable")[:].astype(bool)
    return Recording(
        name=path.stem,
        joints=names,
        time=_time(file, path, len(position), rate),
        units=tuple(str(u) for u in _listed(attributes.get("units"), path, "units")) or _units(names, signals),
        frames=_frames(file, path),
        source=str(path),
        **signals,  # pyright: ignore[reportArgumentType]
        **optional,
    )


def default_joints(count: int) -> tuple[str, ...]:
    """Joint names of a log that has none: ALOHA's for 14 columns, else joint1, joint2, …."""
    return ALOHA_JOINTS if count == len(ALOHA_JOINTS) else tuple(f"joint{i + 1}" for i in range(count))


def _units(names: tuple[str, ...], signals: Mapping[str, np.ndarray | None]) -> tuple[str, ...]:
    """Units of a file that says none: "1" for the grippers of 14 joints where within 0..1, else rad."""
    units = ["rad"] * len(names)
    if len(names) == len(ALOHA_JOINTS):
        for column in (c for c in (6, 13) if "gripper" in names[c].lower()):
            found = [x[:, column] for x in (signals["position"], signals["command"]) if x is not None]
            if all(np.all((x >= NORMALISED[0]) & (x <= NORMALISED[1])) for x in found):
                units[column] = "1"
    return tuple(units)


def _time(file: h5py.File, path: Path, count: int, rate: float | None) -> np.ndarray:
    for key in ("timestamps", "timestamp"):
        if key in file:
            time = np.ravel(_dataset(file, key)[()]).astype(float)
            if time.size != count:
                raise RecordingError(f"{path}: /{key} has {time.size} times for {count} rows of /{_POSITION}")
            return time
    known = [float(np.ravel(np.asarray(file.attrs[key]))[0]) for key in ("rate", "fps") if key in file.attrs]
    hertz = rate if rate is not None else (known[0] if known else None)
    if hertz is None:
        raise RecordingError(f"{path}: it has no /timestamps; give the sampling rate with `--rate HZ` (rate=HZ)")
    if not (np.isfinite(hertz) and hertz > 0):
        raise RecordingError(f"{path}: the sampling rate is {hertz:g} Hz; it must be above 0")
    return np.arange(count) / hertz


def _dataset(file: h5py.File, key: str) -> h5py.Dataset:
    node = file[key]
    if not isinstance(node, h5py.Dataset):
        raise RecordingError(f"{file.filename}: /{key} is a group, but a dataset is expected")
    return node


def _signal(file: h5py.File, path: Path, key: str) -> np.ndarray | None:
    if key not in file:
        return None
    data = _dataset(file, key)
    if data.ndim != 2 or not (np.issubdtype(data.dtype, np.number)):
        raise RecordingError(
            f"{path}: /{key} is {data.dtype} of shape {data.shape}; numbers of shape (T, n) are expected"
        )
    return data[:].astype(float)


def _contents(file: h5py.File) -> str:
    found: list[str] = []
    file.visititems(lambda name, node: found.append(f"/{name}") if isinstance(node, h5py.Dataset) else None)
    return ", ".join(found[:12]) or "no dataset at all"


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _listed(value: Any, path: Path, name: str) -> list[Any]:
    """A list attribute: an array of strings, or JSON."""
    if value is None:
        return []
    if isinstance(value, (str, bytes)):
        try:
            value = json.loads(value)
        except ValueError as error:
            raise RecordingError(f"{path}: the attribute {name} is neither a list of strings nor JSON") from error
    if isinstance(value, (dict, str, int, float)):
        raise RecordingError(f"{path}: the attribute {name} must be a list of strings")
    return [_text(item) for item in np.ravel(value).tolist()]


def _frames(file: h5py.File, path: Path) -> dict[str, FrameSource]:
    group = file.get(_IMAGES)
    if not isinstance(group, h5py.Group):
        return {}
    frames: dict[str, FrameSource] = {}
    for camera, data in group.items():
        raw = isinstance(data, h5py.Dataset) and data.ndim == 4 and data.shape[3] == 3 and data.dtype == np.uint8
        coded = isinstance(data, h5py.Dataset) and data.ndim in (1, 2)
        if not raw and not coded:
            what = f"{data.dtype} of shape {data.shape}" if isinstance(data, h5py.Dataset) else "a group"
            raise RecordingError(
                f"{path}: /{_IMAGES}/{camera} is {what}; uint8 (T, H, W, 3) or one JPEG per row is expected"
            )
        frames[camera] = Hdf5Frames(str(path.resolve()), f"{_IMAGES}/{camera}", int(data.shape[0]))
    return frames


def write_aloha_hdf5(recording: Recording, path: str | Path) -> None:
    """Write a recording in the ALOHA layout, float64, frames raw and one at a time; it reads back equal."""
    with h5py.File(path, "w") as file:
        file["timestamps"] = recording.time
        file[_POSITION] = recording.position
        for name, key in _SIGNALS.items():
            if getattr(recording, name) is not None:
                file[key] = getattr(recording, name)
        if not recording.usable.all():
            file["observations/usable"] = recording.usable
        for camera, frames in recording.frames.items():
            first = frames[0]
            data = file.create_dataset(
                f"{_IMAGES}/{camera}", (len(frames), *first.shape), np.uint8, chunks=(1, *first.shape)
            )
            for index in range(len(frames)):
                data[index] = frames[index]
        file.attrs.update({"sim": False, "compress": False})  # ACT's loader indexes both
        file.attrs["joint_names"] = list(recording.joints)
        file.attrs["units"] = list(recording.units)
        file.attrs["noise"], file.attrs["quantum"] = recording.noise, recording.quantum
        file.attrs["command_hold"], file.attrs["kind"] = recording.command_hold, recording.kind
