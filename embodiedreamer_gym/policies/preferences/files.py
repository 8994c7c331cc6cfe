"""Trajectories as HDF5 files: arrays as they are, the rest as attributes; nothing that runs code when it is read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.policies.preferences.trajectory import Trajectory

KIND, VERSION = "embodiedreamer trajectories", 1
ARRAYS = ("actions", "means", "counts")


def save_trajectories(
    trajectories: Sequence[Trajectory], path: str | Path, about: Mapping[str, Any] | None = None
) -> Path:
    """Write trajectories, whole or not at all; about: what JSON can hold.

    Raises: PolicyError where the file cannot be written.
    """
    with atomic_file(path, PolicyError) as part, h5py.File(part, "w") as file:
        file.attrs.update(kind=KIND, version=VERSION, about=json.dumps(about or {}), count=len(trajectories))
        for number, one in enumerate(trajectories):
            _write(one, file.create_group(f"{number:06d}"))
    return Path(path)


def load_trajectories(path: str | Path) -> tuple[list[Trajectory], dict[str, Any]]:
    """Read what `save_trajectories` wrote: the trajectories, and what it says about them.

    Raises: PolicyError for a missing, damaged or other file.
    """
    path = Path(path)
    if not path.is_file():
        raise PolicyError(f"{path} does not exist; give a file of rollouts or of a preference set.")
    try:
        with h5py.File(path, "r") as file:
            about: dict[str, Any] = dict(file.attrs)
            if about.get("kind") != KIND or about["version"] != VERSION:
                raise PolicyError(f"{path} holds no trajectories of this version.")
            return [_read(file[f"{number:06d}"]) for number in range(about["count"])], json.loads(about["about"])
    except PolicyError:
        raise
    except Exception as error:  # whatever a damaged or foreign file raises
        raise PolicyError(f"{path} holds no trajectories: damaged, or another file.") from error


def _write(one: Trajectory, group: h5py.Group) -> None:
    """One trajectory; frames are packed."""
    for name in ARRAYS:
        group.create_dataset(name, data=getattr(one, name))
    for name, values in one.observations.items():
        packed = {"compression": "gzip", "compression_opts": 1} if values.ndim > 2 else {}
        group.create_dataset(f"observations/{name}", data=values, **packed)
    group.attrs.update(seed=one.seed, attempt=one.attempt)
    for name, value in one.outcome.items():
        group.attrs[f"outcome.{name}"] = float(value)


def _read(group: Any) -> Trajectory:
    observations: dict[str, np.ndarray] = {}

    def keep(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            observations[name] = node[()]

    group["observations"].visititems(keep)
    outcome = {k.removeprefix("outcome."): float(v) for k, v in group.attrs.items() if k.startswith("outcome.")}
    arrays = {name: group[name][()] for name in ARRAYS}
    return Trajectory(observations, **arrays, seed=int(group.attrs["seed"]), attempt=int(group.attrs["attempt"]),
                      outcome=outcome)  # fmt: skip
