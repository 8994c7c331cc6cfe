"""add_effect: a model with one more effect, refitted, before and after."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, start_of
from embodiedreamer_gym.diagnosis.compare import Comparison, compare
from embodiedreamer_gym.diagnosis.screening import grounds, screen_effect
from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.signals import with_effort_unit
from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.robot import RobotModel

MAX_SECONDS = 120.0  # of motion to learn from


@dataclass(frozen=True, eq=False)
class Addition:
    """Calibrations without and with an effect, and both compared on held-out recordings."""

    effect: str
    before: Calibration
    after: Calibration
    comparison: Comparison


def add_effect(
    model: RobotModel, name: str, train: Sequence[Recording], test: Sequence[Recording],
    progress: ProgressCallback | None = None,
) -> Addition:  # fmt: skip
    """Calibrate the model, add the effect of that name, fit everything again and compare on held-out recordings.

    Raises: EffectError for an unknown effect, ModelError when the model has it already.
    """
    progress = progress_or_silence(progress)
    kind = find_effect(name, model.catalogue)
    richer = model.with_effect(kind)
    logs = with_effort_unit(model, [*train, *test])
    train, test = thin(logs[: len(train)], MAX_SECONDS), logs[len(train) :]
    begun = time.perf_counter()
    problem, fit = fit_least_squares(model, train, progress=progress)
    before = finish(problem, fit, time.perf_counter() - begun)
    begun = time.perf_counter()
    short, around = grounds(problem, fit, model)
    found = screen_effect(kind, around, short, np.ones(model.n))
    richer = before.model.with_effect(kind)
    new = Problem(richer, train, hold=problem.hold)
    after = finish(
        new,
        minimise(new, start_of(new, found.start), ITERATIONS, progress=progress),
        time.perf_counter() - begun,
    )
    return Addition(name, before, after, compare([before.model, after.model], test))
