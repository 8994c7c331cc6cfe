"""An entry that always names Coulomb friction on every joint, whatever the recordings show."""

from __future__ import annotations

from embodiedreamer_gym.bench.entries.finding import Finding, named
from embodiedreamer_gym.bench.task import Task
from embodiedreamer_gym.diagnosis import add_effect

NAME = "coulomb_friction"


def answer(task: Task) -> Finding:
    """Name Coulomb friction with fitted values."""
    model = add_effect(task.model, NAME, task.train, task.test).after.model
    return Finding("missing", (named(model, NAME),), task.predictions(model))
