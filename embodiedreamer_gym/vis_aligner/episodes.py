"""Episodes from files: real frames, and beside them what the simulator shows of the same instants."""

from __future__ import annotations

import json
from collections.abc import Sequence
from glob import glob
from pathlib import Path

import h5py
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import CLASS_NAMES, Condition, Episode


def load_episode(path: str | Path, camera: str = "head") -> Episode:
    """An episode of an HDF5 file as `standin film` and `vis prepare` write it.

    `/observations/images/<camera>` are the real frames, `/observations/sim/<camera>/rgb|classes|depth|parts|projections` the
    simulator's (all after classes optional);
    of a real clip, `/observations/masks/<camera>` are the objects' masks, which count instead of the simulator's.
    Raises: VisionError where something is missing or does not fit.
    """
    path = Path(path)
    if not path.is_file():
        raise VisionError(f"{path}: there is no such file.")
    try:
        with h5py.File(path, "r") as file:
            frames, rgb, classes = (
                _read(file, f"observations/{key}", path)
                for key in (f"images/{camera}", f"sim/{camera}/rgb", f"sim/{camera}/classes")
            )
            depth, parts, projections = (
                None if (data := file.get(f"observations/sim/{camera}/{key}")) is None else np.asarray(data)
                for key in ("depth", "parts", "projections")
            )
            depth = None if depth is None else depth.astype(np.float32)
            clean = file.get(f"observations/clean/{camera}")
            clean = None if clean is None else np.asarray(clean)
            look = json.loads(str(file.attrs["look"])).get("name", "") if "look" in file.attrs else ""
            names = tuple(json.loads(str(file.attrs["class_names"]))) if "class_names" in file.attrs else CLASS_NAMES
    except (OSError, ValueError) as error:
        raise VisionError(_damaged(path)) from error
    return Episode(path.stem, frames, Condition(rgb, classes, depth, parts, projections), clean, names, str(look))


def load_episodes(patterns: Sequence[str | Path], camera: str = "head") -> list[Episode]:
    """Episodes of files, folders and globs, sorted.

    Raises: VisionError where nothing is found, or sizes differ.
    """
    episodes = [load_episode(path, camera) for path in expand(patterns)]
    sizes = {e.condition.size for e in episodes}
    if len(sizes) > 1:
        raise VisionError(f"the episodes have pictures of several sizes, {sorted(sizes)}; all must have one.")
    return episodes


def expand(patterns: Sequence[str | Path]) -> list[Path]:
    """Files of files, folders and globs, sorted within each.

    Raises: VisionError where nothing is found.
    """
    paths: list[Path] = []
    for pattern in patterns:
        path = Path(pattern)
        found = sorted(path.glob("*.hdf5")) if path.is_dir() else sorted(Path(p) for p in glob(str(pattern)))
        if not found:
            raise VisionError(f"{pattern}: there is no episode; give HDF5 files or a folder of them.")
        paths += found
    return paths


def load_scene(path: str | Path) -> tuple[np.ndarray | None, dict[str, np.ndarray] | None]:
    """Joints (n,) and poses of the props (7,) at an episode's first frame, where the file has them.

    Raises: VisionError for a file that cannot be read.
    """
    try:
        with h5py.File(path, "r") as file:
            joints, things = file.get("observations/qpos"), file.get("objects")
            names = list(things) if isinstance(things, h5py.Group) else None
            poses = None if names is None else {name: _read(file, f"objects/{name}", Path(path))[0] for name in names}
            return _read(file, "observations/qpos", Path(path))[0] if joints is not None else None, poses
    except (OSError, ValueError) as error:
        raise VisionError(_damaged(path)) from error


def _damaged(path: str | Path) -> str:
    return f"{path}: damaged, cut short or not an HDF5 file; film or copy it again."


def _read(file: h5py.File, key: str, path: Path) -> np.ndarray:
    data = file.get(key)
    if not isinstance(data, h5py.Dataset):
        raise VisionError(f"{path}: the dataset /{key} is missing; film the episode, or prepare a real one first.")
    return np.asarray(data)
