"""A model with an effect on trial: the joints that have it, and its size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.robot import ParameterKey, ParameterRow, RobotModel

CURVE = 3  # exponent from a slider's position to a value: most of its range is for small values


def value_of(row: ParameterRow, size: float) -> float:
    """Value of a parameter, in its unit, at a slider position: -1 (lowest), 0 (off), 1 (highest) or between."""
    off = row.low if row.off is None else row.off
    end = row.high if size >= 0 else row.low
    return float(np.clip(off + min(abs(size), 1.0) ** CURVE * (end - off), row.low, row.high))


def size_of(row: ParameterRow) -> float:
    """Slider position for the parameter's value; see `value_of`."""
    off = row.low if row.off is None else row.off
    away = row.value - off
    end = row.high if away >= 0 else row.low
    return float(np.sign(away) * (away / (end - off)) ** (1 / CURVE)) if end != off else 0.0


def reach(row: ParameterRow) -> tuple[float, float]:
    """Lowest and highest position of a parameter's slider."""
    off = row.low if row.off is None else row.off
    return (-1.0 if off > row.low else 0.0), (1.0 if off < row.high else 0.0)


def with_trial(model: RobotModel, name: str, joints: Sequence[str]) -> RobotModel:
    """The model with an effect added on these joints but off, and with its shape parameters at typical values."""
    kind = find_effect(name, model.catalogue)
    richer = model.with_effect(kind, tuple(joints))
    shapes = {p.name: p for p in kind.parameters if p.shape}
    values: dict[str, dict[str, float]] = {}
    for row in richer.parameters().of_effect(kind.name):
        if row.key.parameter in shapes:
            p = shapes[row.key.parameter]
            scale = (row.high - row.low) / (p.high - p.low)
            values.setdefault(str(row.key.group), {})[row.key.place] = float(
                np.clip(p.typical * scale, row.low, row.high)
            )
    return richer.with_values(values)


def on_joints(model: RobotModel, richer: RobotModel, name: str, joints: Sequence[str]) -> RobotModel:
    """The trial on other joints; joints that already had the effect keep their values."""
    new = with_trial(model, name, joints)
    have = {row.name for row in new.parameters()}
    kept: dict[str, dict[str, float]] = {}
    for row in richer.parameters().of_effect(name):
        if row.name in have:
            kept.setdefault(str(row.key.group), {})[row.key.place] = row.value
    return new.with_values(kept)


def rows_at(model: RobotModel, group: str, places: Iterable[str] = ()) -> list[ParameterRow]:
    """Rows of a group of parameters at these places, or at all places if none are given.

    Raises: EffectError when the model has no such parameter there.
    """
    wanted = set(places)
    rows = [r for r in model.parameters().select(ParameterKey.of(group)) if not wanted or r.key.place in wanted]
    if not rows:
        raise EffectError(f"the model has no parameter {group}{' at ' + ', '.join(sorted(wanted)) if wanted else ''}.")
    return rows
