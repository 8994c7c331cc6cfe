"""Parts of a drive, built from a model and its parameter sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import Effect, Mechanics, MechanicsChange, SignalLaw
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.robot.data import GRAVITY


@dataclass(slots=True)
class Law:
    """A signal law in a drive.

    effect: the effect that defines the law.
    p: its parameters, arrays (B, joints or arms).
    memory: its state between steps.
    """

    effect: SignalLaw
    p: SimpleNamespace
    memory: Any = None


def gear_parts(mechanics: Mechanics, sets: int, n: int, rollouts: int) -> np.ndarray:
    """Compliance, settling time and half the gap (3, B, n) between motors and joints; (3, 0, 0) if all are rigid."""
    parts = mechanics.compliance, mechanics.settling, mechanics.gap / 2
    if not (mechanics.compliance.any() or mechanics.gap.any()):
        return np.zeros((3, 0, 0))
    return np.stack([tile(np.broadcast_to(part, (sets, n)), rollouts) for part in parts])


def tile(values: np.ndarray, rollouts: int) -> np.ndarray:
    """Values (P, m) repeated for each rollout, in C order, because Numba compiles each memory layout separately."""
    return np.ascontiguousarray(np.tile(values, (rollouts, 1)))


def parameter_values(
    effect: Effect, model: RobotModel, sets: Mapping[ParameterKey, np.ndarray], count: int
) -> dict[str, np.ndarray]:
    """An effect's parameters as arrays (P, joints or arms): from the sets if given, else the model's own values."""
    arrays = {}
    for p in effect.parameters:
        key = ParameterKey(p.name, effect.name)
        own = model.group_values(key)
        values = np.array(np.broadcast_to(sets.get(key, own), (count, len(own))))
        if p.is_limit:  # a limit that is off is infinite
            values[values >= model.parameter_off(p) * (1 - 1e-9)] = np.inf
        arrays[p.name] = values
    return arrays


def arm_blocks(arm: np.ndarray) -> np.ndarray:
    """First joint of each arm, then n; a single block if the joints of an arm are not consecutive."""
    starts = [0, *(np.flatnonzero(np.diff(arm)) + 1).tolist()]
    if len(starts) > len(np.unique(arm)):
        starts = [0]
    return np.array([*starts, len(arm)], np.int64)


def changed_mechanics(model: RobotModel, rotor_inertia: np.ndarray, values) -> Mechanics:
    """The rigid bodies of P parameter sets, after all changes of mechanics."""
    count = len(rotor_inertia)
    changes = [(e, p) for e, p in values if isinstance(e, MechanicsChange)]
    nominal = model.nominal_mechanics
    many = count if changes else 1
    mechanics = Mechanics(
        *(np.repeat(x, many, axis=0) for x in (nominal.mass, nominal.first_moment, nominal.inertia)),
        gravity=np.broadcast_to(GRAVITY, (many, model.tree.arms, 3)).copy(),
        rotor_inertia=np.array(rotor_inertia),
        tip_body=nominal.tip_body,
        tip_point=nominal.tip_point,
    )
    for effect, p in changes:
        effect.change(mechanics, SimpleNamespace(**p))
    return mechanics


def cut_memory(memory: Any, batch: int) -> Any:
    """Keep the first samples of a memory: arrays (B, ...), or tuples and dicts of them."""
    if isinstance(memory, np.ndarray) and memory.ndim:
        return memory[:batch]
    if isinstance(memory, tuple):
        return tuple(cut_memory(m, batch) for m in memory)
    if isinstance(memory, dict):
        return {k: cut_memory(m, batch) for k, m in memory.items()}
    return memory
