"""A filmed episode as an HDF5 file: the ALOHA layout, plus the simulator's renderings of the same states."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from embodiedreamer_gym.engines.bullet.rendering import Frame
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.fingerprint import check_settings

CAMERA = "head"
IMAGES, CLEAN, MASKS = (f"observations/{kind}/{CAMERA}" for kind in ("images", "clean", "masks"))
SIMULATED = f"observations/sim/{CAMERA}"
LISTS = ("joint_names", "units")  # attributes stored as arrays of strings, as in recordings


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """A path-traced picture (H, W, 3), uint8, with sensor noise and without."""

    noisy: np.ndarray
    clean: np.ndarray


@dataclass(frozen=True, eq=False)
class SimulatorFrame:
    """The simulator's rendering; masks (H, W) uint8: classes of the path-traced picture's pixels."""

    frame: Frame
    masks: np.ndarray


def write_episode(path: Path, signals: Mapping[str, np.ndarray], pictures: Iterable[tuple[CameraFrame, SimulatorFrame]],
                  attributes: Mapping[str, Any]) -> None:  # fmt: skip
    """Write an episode to a temporary file, one picture at a time, and rename it when it is complete.

    signals: arrays (T, ...) by dataset; attributes: mappings and lists are stored as JSON.
    Raises: RecordingError when it cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with h5py.File(part, "w") as file:
            for key, array in signals.items():
                file[key] = array
            count = len(signals["action"])
            for number, pair in enumerate(pictures):
                for key, picture in _datasets(*pair).items():
                    data = file[key] if key in file else _create_dataset(file, key, count, picture)
                    data[number] = picture  # pyright: ignore[reportIndexIssue]
            file.attrs.update({"sim": False, "compress": False})  # ACT's loader indexes both
            for key, value in attributes.items():
                packed = isinstance(value, dict | list) and key not in LISTS
                file.attrs[key] = json.dumps(value) if packed else value
        part.replace(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        part.unlink(missing_ok=True)


def is_filmed(path: Path, settings: Mapping[str, Any]) -> bool:
    """Whether the path holds this episode already.

    Raises: RecordingError when it holds something else, or an episode of other settings.
    """
    if not path.exists():
        return False
    try:
        with h5py.File(path, "r") as file:
            existing = dict(json.loads(str(file.attrs["film"])))
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise RecordingError(f"{path} is in the way: it is no filmed episode; give another folder.") from error
    check_settings(path, existing, settings, "filmed")
    return True


def _datasets(camera: CameraFrame, simulator: SimulatorFrame) -> dict[str, np.ndarray]:
    """Pictures by dataset; depth to a millimetre."""
    simulated = {f"{SIMULATED}/{key}": array for key, array in simulator.frame.as_dict().items()}
    simulated[f"{SIMULATED}/depth"] = simulator.frame.depth.astype(np.float16)
    return {IMAGES: camera.noisy, CLEAN: camera.clean, MASKS: simulator.masks, **simulated}


def _create_dataset(file: h5py.File, key: str, count: int, picture: np.ndarray) -> h5py.Dataset:
    """A dataset for `count` pictures: camera images uncompressed, as loggers write them, the others compressed."""
    packed: dict[str, Any] = {} if key == IMAGES else {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    return file.create_dataset(key, (count, *picture.shape), picture.dtype, chunks=(1, *picture.shape), **packed)
