"""The cameras of the Cobot Magic, and files of calibrated cameras."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import ModelError, brief
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.io.files import read_json, write_json

__all__ = ["CAMERAS", "Camera", "load_cameras", "look_at", "save_cameras"]

NEEDED = ("position", "rotation", "size", "fx", "fy", "cx", "cy")
OPTIONAL = ("link", "near", "far")


def _wrist(side: str) -> Camera:
    """A camera on the bracket above the gripper, its axis tilted by 0.35 rad towards the gripper's (URDF frames).

    Source: agilexrobotics/mobile_aloha_sim, aloha_tracer2_dabai_dark.urdf (its link6 is turned by 90 degrees).
    """
    position, ahead = (-0.072, 0.012, 0.02), (math.sin(0.35), 0.0, math.cos(0.35))
    rotation = look_at(position, np.add(position, ahead).tolist(), up=(-1.0, 0.0, 0.0))
    return Camera.from_fov(f"{side}_wrist", position, rotation, fovy=55.0, link=f"{side}_link6", near=0.02)


def _head() -> Camera:
    """The camera near the top of the mast, where it sees table and grippers from above the arms' bases.

    Source: position and travel (z 0.866 .. 1.366 m) of agilexrobotics/mobile_aloha_sim, aloha_tracer2_dabai_dark.urdf;
    a lens of less than 72 degrees would cut off grippers at home or the corners of the table's near edge.
    """
    position, tilt = (0.24, 0.0, 1.36), math.radians(57.0)
    rotation = look_at(position, np.add(position, (math.cos(tilt), 0.0, -math.sin(tilt))).tolist())
    return Camera.from_fov("head", position, rotation, fovy=75.0)


CAMERAS: Mapping[str, Camera] = MappingProxyType({c.name: c for c in (_head(), _wrist("left"), _wrist("right"))})


def load_cameras(path: str | Path) -> dict[str, Camera]:
    """Read cameras from a JSON file, by name: {"cameras": {"head": {"position": [...], "rotation": [...], ...}}}.

    The keys are the fields of Camera; link, near and far may be left out.
    Raises: ModelError that names the camera and the key.
    """
    if not isinstance(path, (str, Path)):
        raise ModelError(f"a camera file must be given as a path, not as {brief(path)}.")
    path = Path(path)
    data = read_json(path, ModelError, "camera file")
    entries = data.get("cameras") if isinstance(data, dict) and set(data) == {"cameras"} else None
    if not isinstance(entries, dict) or not entries:
        raise ModelError(
            f'camera file {path} must be {{"cameras": {{name: {{{", ".join(NEEDED)}}}}}}} and nothing else.'
        )
    return {name: _camera(name, entry, path) for name, entry in entries.items()}


def save_cameras(cameras: Mapping[str, Camera] | Iterable[Camera], path: str | Path) -> None:
    """Write cameras atomically to a JSON file for `load_cameras`.

    Raises: ModelError when two have the same name, or the file cannot be written.
    """
    found = list(cameras.values() if isinstance(cameras, Mapping) else cameras)
    names = [camera.name for camera in found]
    if len(set(names)) != len(names):
        raise ModelError(f"two cameras have the same name; names: {', '.join(names)}.")
    entries = {c.name: {f.name: getattr(c, f.name) for f in fields(c) if f.name != "name"} for c in found}
    write_json({"cameras": entries}, path, ModelError)


def _camera(name: str, entry: Any, path: Path) -> Camera:
    """The camera of one entry."""
    where = f"camera file {path}, camera {name}"
    if not isinstance(entry, dict):
        raise ModelError(f"{where}: must be an object with the keys {', '.join(NEEDED)}.")
    for key in entry:
        if key not in NEEDED + OPTIONAL:
            raise ModelError(f"{where}: unknown key {brief(key)}; known keys: {', '.join(NEEDED + OPTIONAL)}.")
    for key in NEEDED:
        if key not in entry:
            raise ModelError(f"{where}: key '{key}' is missing.")
    for key, value in entry.items():
        if key == "link":
            good, wanted = value is None or isinstance(value, str), "the name of a link, or null"
        elif key in ("position", "rotation", "size"):
            good, wanted = isinstance(value, list) and all(map(_is_number, value)), "a list of numbers"
        else:
            good, wanted = _is_number(value), "a number"
        if not good:
            raise ModelError(f"{where}: {key} must be {wanted}, not {json.dumps(value)[:60]}.")
    try:
        return Camera(name=name, **entry)
    except ModelError as error:
        raise ModelError(f"camera file {path}, {error}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
