"""This project: `diagnose` with the effects that the case allows, in one process."""

from __future__ import annotations

from embodiedreamer_gym.bench.answers import NamedEffect
from embodiedreamer_gym.bench.entries.finding import Finding, named
from embodiedreamer_gym.bench.task import Task
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.effects import CATALOGUE


def answer(task: Task) -> Finding:
    """Diagnose the model; if no effect is named, predict with the calibrated model or the closest effect."""
    known = {name: kind for name, kind in CATALOGUE.items() if name in task.effects}
    found = diagnose(task.model, task.train, task.test, catalogue=known, jobs=1)
    own = {effect.name for effect in found.model.effects}  # for a tie, only one of its effects
    effects = tuple(
        named(found.model, name, found.members.get(name)) if name in own else NamedEffect(name, found.members.get(name))
        for name in found.effects
    )
    return Finding(found.verdict, effects, task.predictions(found.model))
