"""Loads episodes from files: real frames, and the simulator's view at the same instants."""

from __future__ import annotations

from collections.abc import Sequence
from glob import glob
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.recordings.frames import MAX_EDGE
from embodiedreamer_gym.recordings.hdf5 import POSITION, open_hdf5
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, Condition

MOST_PARTS, MOST_POINTS = 255, 1000  # rigid parts, numbered in a byte; points of a hull
ADVICE = "film or copy it again"


def load_episode(path: str | Path, camera: str = "head") -> Episode:
    """An episode from an HDF5 file as `standin film` and `vis prepare` write it.

    `/observations/images/<camera>`: real frames.
    `/observations/sim/<camera>/rgb|classes|depth|parts|projections|hulls`: the simulator's view; all after classes are
    optional. In a real clip, classes take the objects from their masks in `/observations/masks/<camera>`.
    Raises: VisionError where something is missing or shapes do not match.
    """
    path, simulated = Path(path), f"observations/sim/{camera}"
    with open_hdf5(path, VisionError, ADVICE) as file:
        images = f"observations/images/{camera}"
        shape = file.dataset(images).shape
        if len(shape) != 4 or max(shape[1:3]) > MAX_EDGE:
            raise VisionError(f"/{images} has shape {shape}; (T, H, W, 3) with at most {MAX_EDGE} pixels is expected.")
        axes = {"classes": 3, "rgb": 4, "depth": 3, "parts": 3}  # shared with the images
        places = {f"{simulated}/{name}": shape[:count] for name, count in axes.items()}
        projected, hull = (
            file.dataset(key).shape if key in file else () for key in (f"{simulated}/projections", f"{simulated}/hulls")
        )
        parts = tuple(min(count, MOST_PARTS) for count in projected[1:2])
        places[f"{simulated}/projections"] = shape[0], *parts, 3, 4
        places[f"{simulated}/hulls"] = *parts, *(min(count, MOST_POINTS) for count in hull[1:2]), 3
        places |= {images: shape, f"observations/clean/{camera}": shape}
        for key, expected in places.items():
            if key in file and file.dataset(key).shape != expected:
                raise VisionError(
                    f"/{key} has shape {file.dataset(key).shape}, the images {shape}; they must agree, it must be {expected}."
                )
        rgb, classes, frames = (file.read(key) for key in (f"{simulated}/rgb", f"{simulated}/classes", images))
        optional = (
            *(f"{simulated}/{name}" for name in ("depth", "parts", "projections", "hulls")),
            f"observations/clean/{camera}",
        )
        depth, parts, projections, hulls, clean = (file.read(key) if key in file else None for key in optional)
        depth = None if depth is None else depth.astype(np.float32)
        if classes.dtype != np.uint8 or (parts is not None and parts.dtype != np.uint8):
            raise VisionError("classes and parts must be uint8.")
        if hulls is not None and not np.isfinite(hulls).all():
            raise VisionError("hulls must be finite numbers, m.")
        filmed = file.json("look", {})  # the attribute that `standin film` writes
        names = file.strings("class_names") or CLASS_NAMES
        appearance = str(filmed.get("name", "")) if isinstance(filmed, dict) else ""
        condition = Condition(rgb, classes, depth, parts, projections, hulls)
        return Episode(path.stem, frames, condition, clean, names, appearance)


def load_episodes(patterns: Sequence[str | Path], camera: str = "head") -> list[Episode]:
    """Episodes from files, folders and globs, sorted.

    Raises: VisionError where nothing is found, or sizes differ.
    """
    episodes = [load_episode(path, camera) for path in expand(patterns)]
    sizes = {e.condition.size for e in episodes}
    if len(sizes) > 1:
        raise VisionError(f"the episodes have pictures of several sizes, {sorted(sizes)}; all must have one.")
    return episodes


def expand(patterns: Sequence[str | Path]) -> list[Path]:
    """Paths from files, folders and globs, sorted within each.

    Raises: VisionError where nothing is found.
    """
    paths: list[Path] = []
    for pattern in patterns:
        path = Path(pattern)
        files = sorted(path.glob("*.hdf5")) if path.is_dir() else sorted(Path(p) for p in glob(str(pattern)))
        if not files:
            raise VisionError(f"{pattern}: there is no episode; give HDF5 files or a folder of them.")
        paths += files
    return paths


def load_scene(path: str | Path) -> tuple[np.ndarray | None, dict[str, np.ndarray] | None]:
    """Joints (n,) and poses of the props (7,) at an episode's first frame; None where the file does not have them.

    Raises: VisionError for a file that cannot be read.
    """
    with open_hdf5(path, VisionError, ADVICE) as file:
        poses = {name: rows[0] for name, rows in file.object_poses().items()} if "objects" in file else None
        return file.signal(POSITION)[0] if POSITION in file else None, poses
