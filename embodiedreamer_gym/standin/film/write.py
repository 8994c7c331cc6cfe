"""A filmed episode as an HDF5 file: the ALOHA layout, plus the simulator's renderings of the same states."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.bullet.rendering import Frame
from embodiedreamer_gym.io.fingerprint import check_settings
from embodiedreamer_gym.recordings.hdf5 import LAYOUT_FLAGS, new_hdf5, read_settings, write_attributes, write_rows

CAMERA = "head"
Pictures = Iterable[tuple["CameraFrame", "SimulatorFrame"]]


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


def write_episode(path: Path, signals: Mapping[str, np.ndarray], pictures: Mapping[str, Pictures],
                  attributes: Mapping[str, Any]) -> None:  # fmt: skip
    """Write an episode to a temporary file, one picture at a time, and rename it when it is complete.

    signals: arrays (T, ...) by dataset; pictures: of each camera; attributes: mappings and lists are stored as JSON.
    Raises: RecordingError when it cannot be written.
    """
    packing = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    with new_hdf5(path) as file:
        for key, array in signals.items():
            file[key] = array
        for camera, pairs in pictures.items():
            pairs = iter(pairs)
            first = next(pairs)
            file[f"observations/sim/{camera}/hulls"] = first[1].frame.hulls
            rows = (_datasets(camera, *pair) for pair in itertools.chain([first], pairs))
            write_rows(file, len(signals["action"]), rows, lambda key: {} if "/images/" in key else packing)
        file.attrs.update(LAYOUT_FLAGS)
        write_attributes(file, attributes, ("joint_names", "units"))


def is_filmed(path: Path, settings: Mapping[str, Any]) -> bool:
    """Whether the path holds this episode already.

    Raises: RecordingError when it has other content, or an episode with other settings.
    """
    if not path.exists():
        return False
    check_settings(path, read_settings(path, "film", "filmed episode"), settings, "filmed")
    return True


def _datasets(camera: str, taken: CameraFrame, simulator: SimulatorFrame) -> dict[str, np.ndarray]:
    """Pictures of a camera by dataset; depth to a millimetre."""
    simulated = {f"sim/{camera}/{key}": array for key, array in simulator.frame.as_dict().items() if key != "hulls"}
    simulated[f"sim/{camera}/depth"] = simulator.frame.depth.astype(np.float16)
    pictures = {f"images/{camera}": taken.noisy, f"clean/{camera}": taken.clean, f"masks/{camera}": simulator.masks}
    return {f"observations/{key}": array for key, array in (pictures | simulated).items()}
