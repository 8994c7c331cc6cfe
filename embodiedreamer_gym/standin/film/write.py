"""A filmed episode as an HDF5 file: the ALOHA layout, and beside it what the simulator saw of the same states."""

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
REAL, CLEAN, MASKS = (f"observations/{what}/{CAMERA}" for what in ("images", "clean", "masks"))
SIMULATED = f"observations/sim/{CAMERA}"
LISTS = ("joint_names", "units")  # attributes that are arrays of texts, as recordings have them


@dataclass(frozen=True, eq=False)
class Real:
    """A real-looking picture (H, W, 3), uint8: as the sensor gives it, and clean, without its noise."""

    noisy: np.ndarray
    clean: np.ndarray


@dataclass(frozen=True, eq=False)
class Simulated:
    """What the simulator sees; masks (H, W) uint8: classes of the real picture."""

    frame: Frame
    masks: np.ndarray


def write_episode(path: Path, signals: Mapping[str, np.ndarray], pictures: Iterable[tuple[Real, Simulated]],
                  attributes: Mapping[str, Any]) -> None:  # fmt: skip
    """Write an episode beside its place, a picture at a time as it comes, and rename it when it is whole.

    signals: arrays (T, ...) by dataset; attributes: what is no text or number becomes JSON.
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
                    data = file[key] if key in file else _room(file, key, count, picture)
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
    """Whether an episode is there already.

    Raises: RecordingError when something else is there, or an episode of other settings.
    """
    if not path.exists():
        return False
    try:
        with h5py.File(path, "r") as file:
            there = dict(json.loads(str(file.attrs["film"])))
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise RecordingError(f"{path} is in the way: it is no filmed episode; give another folder.") from error
    check_settings(path, there, settings, "filmed")
    return True


def _datasets(real: Real, simulated: Simulated) -> dict[str, np.ndarray]:
    """Pictures by their place in a file; depth to a millimetre."""
    seen = {f"{SIMULATED}/{key}": array for key, array in simulated.frame.as_dict().items()}
    seen[f"{SIMULATED}/depth"] = simulated.frame.depth.astype(np.float16)
    return {REAL: real.noisy, CLEAN: real.clean, MASKS: simulated.masks, **seen}


def _room(file: h5py.File, key: str, count: int, picture: np.ndarray) -> h5py.Dataset:
    """Room for pictures: the real ones raw, as loggers write them, the others compressed."""
    packed: dict[str, Any] = {} if key == REAL else {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    return file.create_dataset(key, (count, *picture.shape), picture.dtype, chunks=(1, *picture.shape), **packed)
