"""Firmware settings of known servos, as stated by a manufacturer or a driver, as effects of a model."""

from __future__ import annotations

from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import Effect, Parameter, find_effect
from embodiedreamer_gym.errors import ModelError, brief
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.robot.data import RobotData
from embodiedreamer_gym.robot.files import ASSETS

FOLDER = ASSETS / "servos"


def presets() -> tuple[str, ...]:
    """Names of the servos that the package knows."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.json")))


def read_preset(name: Any, path: Path) -> dict[str, Any]:
    """A preset's JSON object: effects, and perhaps gravity_compensation; {} for None.

    Raises: ModelError that lists the names.
    """
    if name is None:
        return {}
    if name not in presets():
        raise ModelError(f"model {path}: there is no servo.preset {brief(name)}; give one of {', '.join(presets())}.")
    return read_json(FOLDER / f"{name}.json", ModelError, "preset")


def preset_effects(preset: Mapping[str, Any], model: RobotData, own: Set[str]) -> tuple[Effect, ...]:
    """A preset's effects on the model's revolute joints, without those that the model's file defines itself (`own`)."""
    entries = [entry for entry in preset.get("effects", []) if entry["name"] not in own]
    return tuple(_effect(entry, model) for entry in entries)


def _effect(entry: Mapping[str, Any], model: RobotData) -> Effect:
    kind, tree = find_effect(entry["name"]), model.tree
    values = {}
    for p in kind.parameters:
        given = entry.get(p.name, {})
        given = dict(given) if isinstance(given, dict) else dict.fromkeys(model.joints, float(given))
        values[p.name] = {}
        for j, joint in enumerate(model.joints):
            bodies = tree.coordinate == j
            value = given.get(joint)
            if value is not None and not tree.prismatic[bodies].any():
                stroke = float(np.abs(tree.gain[bodies]).max())
                values[p.name][joint] = value * stroke ** _power(p)
    return kind(**values)


def _power(p: Parameter) -> int:
    """Power of a normalised joint's stroke, rad, that turns a value in rad and N m into its own unit."""
    return 1 if p.unit == "N m" else -1 if p.unit.startswith("rad") else 0
