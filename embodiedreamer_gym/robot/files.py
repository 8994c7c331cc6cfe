"""Reading and checking the JSON form of a robot model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import ModelError, brief
from embodiedreamer_gym.io.files import read_json as read_checked_json

ASSETS = Path(str(resources.files("embodiedreamer_gym") / "assets"))
BUILT_IN_URDF = "embodiedreamer:"  # prefix of a URDF that the package ships
LARGEST = 1e100  # largest number in a model file: its square is finite
KEYS = ("name", "robot", "servo", "rotor_inertia", "viscous_friction", "command_hold", "effects", "estimated", "fixed",
        "urdf_error", "transmission", "intervals")  # fmt: skip


def built_in_robots() -> tuple[str, ...]:
    """Names of the robots that the package ships."""
    return tuple(sorted(p.stem for p in ASSETS.glob("*.json")))


def find_model(source: str | Path) -> Path:
    """Path of a model file, or of the built-in robot of that name.

    Raises: ModelError that lists the built-in robots.
    """
    path = Path(source)
    if os.path.isfile(path):  # Path.is_file fails at a name that is too long
        return path
    if str(source) in built_in_robots():
        return ASSETS / f"{source}.json"
    raise ModelError(f"model {source} is neither a file nor a built-in robot ({', '.join(built_in_robots())}).")


def read_json(path: Path) -> dict[str, Any]:
    """Read a model's JSON object.

    Raises: ModelError when it is no JSON object, lacks `robot` or has an unknown key.
    """
    data = read_checked_json(path, ModelError, "model")
    if not isinstance(data, dict):
        raise ModelError(f"model {path} must be a JSON object with the key 'robot'.")
    unknown = [key for key in data if key not in KEYS]
    if unknown:
        raise ModelError(f"model {path} has the unknown key {brief(unknown[0])}; known keys: {', '.join(KEYS)}.")
    if not isinstance(data.get("name", ""), str):
        raise ModelError(f"model {path}: name must be a text.")
    robot = data.get("robot")
    if not isinstance(robot, dict) or not isinstance(robot.get("urdf"), str):
        raise ModelError(f'model {path} needs {{"robot": {{"urdf": "arm.urdf", "joints": [...]}}}}.')
    return data


def urdf_path(text: str, model_path: Path) -> Path:
    """Path of the URDF a model names: relative to the model's file, or one that the package ships.

    Raises: ModelError, which names the model, when there is no such file.
    """
    path = model_path.parent / text
    if text.startswith(BUILT_IN_URDF):
        path = ASSETS / "urdf" / text.removeprefix(BUILT_IN_URDF)
    try:
        real = Path(os.path.realpath(path))  # Path.resolve fails at a loop of links
        found = os.path.isfile(real)
    except ValueError as error:  # a null character
        raise ModelError(f"model {model_path}: the urdf {brief(text)} cannot be a path.") from error
    if not found:
        raise ModelError(f"model {model_path}: its URDF {path} does not exist.")
    return path if text.startswith(BUILT_IN_URDF) else real


def urdf_text(urdf: Path, model_path: Path) -> str:
    """Text by which a model's file refers to its URDF."""
    if urdf.parent == ASSETS / "urdf":
        return BUILT_IN_URDF + urdf.name
    return Path(os.path.relpath(os.path.realpath(urdf), os.path.dirname(os.path.realpath(model_path)))).as_posix()


def names(value: Any, what: str, path: Path) -> tuple[str, ...]:
    """A JSON list of names as a tuple.

    Raises: ModelError for anything else.
    """
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise ModelError(f"model {path}: {what} must be a list of names.")
    return tuple(value)


def numbers(value: Any, count: int, what: str, path: Path) -> list[float]:
    """A JSON list of finite numbers of at most LARGEST, one per joint.

    Raises: ModelError for anything else.
    """
    if not isinstance(value, list) or len(value) != count or not all(_is_number(v) for v in value):
        raise ModelError(f"model {path}: {what} must be a list of {count} finite numbers of at most {LARGEST:g}.")
    return [float(v) for v in value]


def table(data: Mapping[str, Any], key: str, known: tuple[str, ...] | None, path: Path) -> dict[str, Any]:
    """A JSON object inside another, empty if it is left out; known: the keys it may have.

    Raises: ModelError for anything else, or a key that is not known.
    """
    value = data.get(key, {})
    if not isinstance(value, dict):
        raise ModelError(f"model {path}: {key} must be an object.")
    for name in value:
        if known is not None and name not in known:
            raise ModelError(
                f"model {path} has the unknown key {brief(name)} in {key}; known keys: {', '.join(known)}."
            )
    return value


def pair(value: Any, what: str, path: Path) -> tuple[float, float]:
    """Two finite numbers.

    Raises: ModelError for anything else.
    """
    first, second = numbers(value, 2, what, path)
    return first, second


def ends(value: Any, what: str, path: Path) -> tuple[float, float]:
    """A joint's values at 0 and at 1 of a normalised gripper.

    Raises: ModelError for anything but two different finite numbers.
    """
    zero, one = pair(value, what, path)
    if zero == one:
        raise ModelError(f"model {path}: {what} must be two different numbers.")
    return zero, one


def by_joint(value: Any, joints: tuple[str, ...], what: str, path: Path) -> dict[str, float]:
    """An effect's parameter: {joint: number}, a list with one number per joint, or one number for all.

    Raises: ModelError for anything else.
    """
    if _is_number(value):
        return dict.fromkeys(joints, float(value))
    if isinstance(value, list):
        return dict(zip(joints, numbers(value, len(joints), what, path), strict=True))
    if isinstance(value, dict) and all(_is_number(v) for v in value.values()):
        return {k: float(v) for k, v in value.items()}
    raise ModelError(f"model {path}: {what} must map joints to finite numbers of at most {LARGEST:g}.")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
