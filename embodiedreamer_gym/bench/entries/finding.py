"""Result of an entry for a case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from embodiedreamer_gym.bench.answers import NamedEffect
from embodiedreamer_gym.robot import RobotModel


@dataclass(frozen=True, eq=False)
class Finding:
    """Verdict (None: the entry names nothing), effects, and predictions (T, n) by name of the motion."""

    verdict: str | None
    effects: tuple[NamedEffect, ...] = ()
    predictions: Mapping[str, np.ndarray] = field(default_factory=dict)


def named(model: RobotModel, effect: str, probability: float | None = None) -> NamedEffect:
    """An effect of a model with its values and, if the last fit computed them, its intervals."""
    parameters: dict[str, dict[str, dict[str, float]]] = {}
    for row in model.parameters().of_effect(effect):
        ends = {} if row.interval is None else {"low": float(row.interval[0]), "high": float(row.interval[1])}
        parameters.setdefault(row.key.parameter, {})[row.key.place] = {"value": float(row.value), **ends}
    joints = sorted({place for rows in parameters.values() for place in rows})
    return NamedEffect(effect, probability, tuple(joints), parameters)
