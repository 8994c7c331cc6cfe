"""Trajectories in HDF5 files: arrays as datasets, the rest as attributes; reading a file runs no code."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py

from embodiedreamer_gym.errors import PolicyError, RecordingError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.policies.preferences.trajectory import Trajectory
from embodiedreamer_gym.recordings.hdf5 import Hdf5File, open_hdf5

KIND, VERSION = "embodiedreamer trajectories", 1
ARRAYS = ("actions", "means", "counts")


def save_trajectories(
    trajectories: Sequence[Trajectory], path: str | Path, about: Mapping[str, Any] | None = None
) -> Path:
    """Write trajectories atomically; about: further data that JSON can hold.

    Raises: PolicyError if the file cannot be written.
    """
    with atomic_file(path, PolicyError) as part, h5py.File(part, "w") as file:
        file.attrs.update(kind=KIND, version=VERSION, about=json.dumps(about or {}), count=len(trajectories))
        for number, one in enumerate(trajectories):
            _write(one, file.create_group(f"{number:06d}"))
    return Path(path)


def load_trajectories(path: str | Path) -> tuple[list[Trajectory], dict[str, Any]]:
    """Read what `save_trajectories` wrote: the trajectories, and `about`.

    Raises: PolicyError for a missing, damaged or other file.
    """
    path = Path(path)
    if not path.is_file():
        raise PolicyError(f"{path} does not exist; give a file of rollouts or of a preference set.")
    try:
        with open_hdf5(path) as file:
            about: dict[str, Any] = dict(file.file.attrs)
            if about.get("kind") != KIND or about["version"] != VERSION:
                raise PolicyError(f"{path} holds no trajectories of this version.")
            rows = [_read(Hdf5File(file.file, path), f"{number:06d}") for number in range(about["count"])]
            return rows, dict(json.loads(about["about"]))
    except RecordingError as error:  # whatever a damaged or foreign file raises
        if isinstance(error.__cause__, PolicyError):
            raise PolicyError(str(error)) from error
        raise PolicyError(f"{path} holds no trajectories; it is damaged or another kind of file.") from error


def _write(one: Trajectory, group: h5py.Group) -> None:
    """Write one trajectory; frames are compressed."""
    for name in ARRAYS:
        group.create_dataset(name, data=getattr(one, name))
    for name, values in one.observations.items():
        packed = {"compression": "gzip", "compression_opts": 1} if values.ndim > 2 else {}
        group.create_dataset(f"observations/{name}", data=values, **packed)
    group.attrs.update(seed=one.seed, attempt=one.attempt)
    for name, value in one.outcome.items():
        group.attrs[f"outcome.{name}"] = float(value)


def _read(file: Hdf5File, name: str) -> Trajectory:
    """Read one trajectory; the sizes of arrays are checked before they are read."""
    group: Any = file.file[name]
    datasets: list[str] = []
    if not isinstance(group["observations"], h5py.Group):
        raise PolicyError(f"/{name}/observations is not a group of arrays.")
    group["observations"].visititems(lambda key, node: datasets.append(key) if isinstance(node, h5py.Dataset) else None)
    observations = {key: file.read(f"{name}/observations/{key}") for key in datasets}
    outcome = {k.removeprefix("outcome."): float(v) for k, v in group.attrs.items() if k.startswith("outcome.")}
    arrays = {key: file.read(f"{name}/{key}") for key in ARRAYS}
    return Trajectory(observations, **arrays, seed=int(group.attrs["seed"]), attempt=int(group.attrs["attempt"]),
                      outcome=outcome)  # fmt: skip
