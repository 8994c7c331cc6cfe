"""diagnose: calibrate, ask whether the model is wrong, add the effect that lowers the held-out error, and judge."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis, summarise
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.refit_cache import Journal
from embodiedreamer_gym.diagnosis.search import Found, Search, look, screen_all
from embodiedreamer_gym.diagnosis.verdict import ALARM, convinces
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.phys_aligner.signals import Signals, with_effort_unit
from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.robot import RobotModel

MAX_SECONDS = 80.0  # of motion to learn from, and as much to judge by


def diagnose(
    model: RobotModel,
    train: Sequence[Recording],
    test: Sequence[Recording],
    catalogue: Mapping[str, type[Effect]] | None = None,
    max_effects: int = 3,
    jobs: int = 2,
    max_seconds: float = MAX_SECONDS,
    rng: np.random.Generator | None = None,
    progress: ProgressCallback | None = None,
    journal: str | Path | None = None,
) -> Diagnosis:
    """Find out which physical effects a model lacks, by free-run error on held-out recordings.

    catalogue: effects to consider (default: the model's); max_effects: the most that are added, one at a time, all
    parameters refitted each time; jobs: processes; max_seconds: of longer recordings the liveliest windows are used,
    but the errors reported are those of the whole held-out recordings; journal: a file that keeps finished refits, so
    that an interrupted diagnosis goes on where it was. The model is calibrated first.
    Raises: CalibrationError or SimulationError when the recordings do not fit the model.
    """
    begun = time.perf_counter()
    if not train or not test:
        raise CalibrationError("diagnose needs recordings to learn from and others, held out, to judge by.")
    logs = with_effort_unit(model, [*train, *test])
    train, test = logs[: len(train)], logs[len(train) :]
    all_test, train, test = test, thin(train, max_seconds), thin(test, max_seconds)
    both = model.command_hold == "unknown" and any(r.command_hold == "unknown" for r in train)
    catalogue = catalogue or model.catalogue
    search = Search(model, train, test, catalogue, jobs, progress_or_silence(progress), both,
                    rng or np.random.default_rng(0), Journal(journal, model, [*train, *test], catalogue),
                    Signals(model, train).unit or "rad")  # fmt: skip
    problem, fit = fit_least_squares(model, train, progress=search.progress)
    calibrated = finish(problem, fit, 0.0)
    search.rollouts += problem.rollouts
    base = evaluate(calibrated.model, test)
    search.progress("drawing faultless robots", 0, None, held_out_error=search.milli(base.error))
    null = draw_null(calibrated.model, fit, problem, test, search.rng)
    search.rollouts += null.rollouts
    p_value = null.p_value(base.chi2)
    screened = screen_all(search, problem, fit, null, first=True)
    found = Found((calibrated.model, problem, fit), base, null)
    if p_value < ALARM:
        found = look(search, found, screened, max_effects)
    steps, tie, held, null = found.steps, found.tie, found.held, found.null
    verdict = _verdict(p_value, base, held, null, steps, tie)
    final = finish(found.current[1], found.current[2], 0.0, null.sway)
    return summarise(
        verdict=verdict, model=model, calibrated=calibrated, final=final, steps=steps, tie=tie, closest=found.closest,
        base=base, held=held, null=null, p_value=p_value, ranking=search.ranking,
        unobservable=search.unobservable, test=all_test, rollouts=search.rollouts, seconds=time.perf_counter() - begun,
    )  # fmt: skip


def _verdict(p_value, base, held, null, steps, tie) -> str:
    if p_value >= ALARM:
        return "nothing_missing"
    if not steps:
        return "unknown"
    if not convinces(base, held, null.chi2):
        return "unknown"
    return "ambiguous" if tie else "missing"
