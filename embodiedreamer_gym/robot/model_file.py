"""A robot model's JSON file: interpreting its keys, and writing it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from embodiedreamer_gym.effects import NUISANCES, Effect, find_effect
from embodiedreamer_gym.effects.catalogue import RENAMED
from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.errors import EffectError, ModelError
from embodiedreamer_gym.io.files import write_json
from embodiedreamer_gym.robot import files
from embodiedreamer_gym.robot.data import SERVO_GROUPS, RobotData, UrdfError
from embodiedreamer_gym.robot.parameters import ParameterKey
from embodiedreamer_gym.robot.servo_preset import preset_effects, read_preset
from embodiedreamer_gym.robot.transmission import Transmission
from embodiedreamer_gym.robot.tree import build_tree

SERVO_KEYS = (*SERVO_GROUPS[:2], "gravity_compensation", "preset")
ROBOT_KEYS = ("urdf", "joints", "end_effectors", "normalised")
TRANSMISSION_KEYS = ("motors", "matrix", "sign", "zero")
Model = TypeVar("Model", bound=RobotData)


def read_model(source: str | Path, catalogue: Mapping[str, type[Effect]], kind: type[Model]) -> Model:
    """Read a model of this class from a JSON file, or a built-in robot by name.

    Raises: ModelError (EffectError for an unknown effect) in one sentence.
    """
    path = files.find_model(source)
    return model_of(files.read_json(path), path, catalogue, kind)


def model_of(data: dict[str, Any], path: Path, catalogue: Mapping[str, type[Effect]], kind: type[Model]) -> Model:
    """The model in a file's JSON object; path: of the file, for relative paths and messages.

    Raises: ModelError (EffectError for an unknown effect) in one sentence.
    """
    robot, servo = files.table(data, "robot", ROBOT_KEYS, path), files.table(data, "servo", SERVO_KEYS, path)
    urdf = files.urdf_path(robot["urdf"], path)
    joints = files.names(robot.get("joints"), "robot.joints", path)
    if not joints:
        raise ModelError(f"model {path} names no joint; list the driven ones in robot.joints.")
    tips = files.names(robot.get("end_effectors", []), "robot.end_effectors", path)
    normalised = {
        joint: files.ends(ends, f"robot.normalised of {joint}", path)
        for joint, ends in files.table(robot, "normalised", joints, path).items()
    }
    try:
        tree = build_tree(urdf, joints, normalised, tips)
    except ModelError as error:
        raise ModelError(f"model {path}: {error}") from error
    preset = read_preset(servo.get("preset"), path)
    stated = {group: data.get(group, servo.get(group)) for group in SERVO_GROUPS}
    given = {k: np.array(files.numbers(v, len(joints), k, path)) for k, v in stated.items() if v is not None}
    estimated = frozenset(files.names(data.get("estimated", []), "estimated", path))
    if estimated - set(SERVO_GROUPS):
        raise ModelError(f"model {path}: estimated may name {', '.join(SERVO_GROUPS)} only.")
    intervals = {
        str(_present(ParameterKey.of(text))): files.pair(ends, f"interval of {text}", path)
        for text, ends in files.table(data, "intervals", None, path).items()
    }
    fields: dict[str, Any] = {
        "name": data.get("name", path.stem), "urdf": urdf, "joints": joints, "tree": tree,
        **dict.fromkeys(SERVO_GROUPS, np.zeros(len(joints))), **given, "given": frozenset(given) - estimated,
        "command_hold": data.get("command_hold", "unknown"), "catalogue": catalogue, "intervals": intervals,
        "normalised": normalised, "end_effectors": tips, "fixed": _read_fixed(data, path),
        "transmission": _read_transmission(data, joints, path),
        "gravity_compensation": _read_compensation({**preset, **servo}, joints, path),
        "urdf_error": UrdfError(**files.table(data, "urdf_error", ("mass", "centre", "inertia"), path)),
    }  # fmt: skip
    fields |= {group: values for group, values in kind(**fields).first_guess().items() if group not in given}
    if not isinstance(data.get("effects", []), list):
        raise ModelError(f"model {path}: effects must be a list of objects, each with a name.")
    plain = kind(**fields)
    effects = [_read_effect(entry, plain, path) for entry in data.get("effects", [])]
    stated = preset_effects(preset, plain, {effect.name for effect in effects})
    fields["fixed"] |= {effect.name for effect in stated}
    return kind(**fields, effects=(*effects, *stated))


def _read_compensation(servo: Mapping[str, Any], joints: tuple[str, ...], path: Path) -> np.ndarray:
    share = files.by_joint(servo.get("gravity_compensation", 0.0), joints, "servo.gravity_compensation", path)
    return np.array([share.get(joint, 0.0) for joint in joints])


def _read_fixed(data: Mapping[str, Any], path: Path) -> frozenset[str]:
    names = files.names(data.get("fixed", []), "fixed", path)
    return frozenset(RENAMED.get(name) or str(_present(ParameterKey.of(name))) for name in names)


def _present(key: ParameterKey) -> ParameterKey:
    """A parameter's key with the current name of its effect."""
    return replace(key, effect=RENAMED.get(key.effect, key.effect))


def _read_transmission(data: dict[str, Any], joints: tuple[str, ...], path: Path) -> Transmission | None:
    """Read the key `transmission`; each of its parts is optional."""
    if "transmission" not in data:
        return None
    table = files.table(data, "transmission", TRANSMISSION_KEYS, path)
    motors = files.names(table.get("motors", list(joints)), "transmission.motors", path)
    rows = table.get("matrix", np.eye(len(joints)).tolist())
    if not isinstance(rows, list) or len(rows) != len(joints) or len(motors) != len(joints):
        raise ModelError(
            f"model {path}: transmission needs {len(joints)} motors and rows of its matrix, one per joint."
        )
    signs = {
        key: files.by_joint(table.get(key, {}), motors, f"transmission.{key}", path) for key in TRANSMISSION_KEYS[2:]
    }
    unknown = [name for values in signs.values() for name in values if name not in motors]
    if unknown:
        raise ModelError(
            f"model {path}: transmission names the motor '{unknown[0]}'; its motors are {', '.join(motors)}."
        )
    matrix = [files.numbers(row, len(joints), "a row of transmission.matrix", path) for row in rows]
    try:
        return Transmission(
            motors,
            np.array(matrix),
            np.array([signs["sign"].get(name, 1.0) for name in motors]),
            np.array([signs["zero"].get(name, 0.0) for name in motors]),
        )
    except ModelError as error:
        raise ModelError(f"model {path}: {error}") from error


def _read_effect(entry: Any, model: RobotData, path: Path) -> Effect:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ModelError(f"model {path}: each effect must be an object with a name.")
    try:
        kind = find_effect(entry["name"], {**model.catalogue, **NUISANCES})
        places = {p.name: model.places(p) for p in kind.parameters}
        return kind(**{
            key: files.by_joint(value, places.get(key, ()), f"effect {kind.name}, {key}", path)
            for key, value in entry.items() if key != "name"
        })  # fmt: skip
    except EffectError as error:
        raise EffectError(f"model {path}: {error}") from error


def write_model(model: RobotData, path: Path) -> None:
    """Write a model's JSON file.

    Raises: ModelError when the folder does not exist or cannot be written.
    """
    robot: dict[str, Any] = {"urdf": files.urdf_text(model.urdf, path), "joints": list(model.joints)}
    if model.end_effectors:
        robot["end_effectors"] = list(model.end_effectors)
    if model.normalised:
        robot["normalised"] = {k: list(v) for k, v in model.normalised.items()}
    scaled = any(isinstance(effect, EffortSensor) and effect.values["scale"] for effect in model.effects)
    fixed = sorted(model.fixed | ({f"{EffortSensor.name}.scale"} if scaled else set()))
    estimated = sorted(set(SERVO_GROUPS) - model.given)
    share = model.gravity_compensation
    weightless = {"gravity_compensation": share.tolist()} if share.any() else {}
    data = {
        "name": model.name,
        "robot": robot,
        "servo": {"stiffness": model.stiffness.tolist(), "damping": model.damping.tolist(), **weightless},
        "rotor_inertia": model.rotor_inertia.tolist(),
        "viscous_friction": model.viscous_friction.tolist(),
        "command_hold": model.command_hold,
        "effects": [{"name": e.name, **e.values} for e in model.effects],
        "intervals": {k: list(v) for k, v in model.intervals.items()},
        **({"estimated": estimated} if estimated else {}),
        **({"fixed": fixed} if fixed else {}),
        **({"transmission": _transmission(model.transmission)} if model.transmission is not None else {}),
        **({"urdf_error": asdict(model.urdf_error)} if model.urdf_error != UrdfError() else {}),
    }
    write_json(data, path, ModelError)


def _transmission(of: Transmission) -> dict[str, Any]:
    """A transmission as written in a model's file, without default values."""
    data: dict[str, Any] = {"motors": list(of.motors)}
    data |= {} if of.is_direct else {"matrix": of.matrix.tolist()}
    data |= {"sign": dict(zip(of.motors, of.sign.tolist(), strict=True))} if (of.sign != 1).any() else {}
    return data | ({"zero": dict(zip(of.motors, of.zero.tolist(), strict=True))} if of.zero.any() else {})
