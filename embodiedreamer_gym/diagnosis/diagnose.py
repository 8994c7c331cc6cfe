"""diagnose: calibrate, test whether the model is wrong, add the effects that lower the held-out error, give a verdict."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis, summarise
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.search import Search, SearchState, screen_all, search_effects
from embodiedreamer_gym.diagnosis.verdict import ALARM, is_convincing
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.parallel import ended_workers
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.phys_aligner.signals import with_effort_unit
from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.robot import RobotModel

MAX_SECONDS = 80.0  # of motion to learn from, and as much to judge by


@renamed_arguments(rng="seed", journal="refit_cache")
def diagnose(
    model: RobotModel,
    train: Sequence[Recording],
    test: Sequence[Recording],
    catalogue: Mapping[str, type[Effect]] | None = None,
    max_effects: int = 3,
    jobs: int = 2,
    max_seconds: float = MAX_SECONDS,
    seed: int | np.random.Generator = 0,
    progress: ProgressCallback | None = None,
    refit_cache: str | Path | None = None,
) -> Diagnosis:
    """Find out which physical effects a model lacks, by free-run error on held-out recordings.

    The model is calibrated first. Errors are reported of the whole held-out recordings.

    train, test: recordings to fit and, held out, to judge by.
    catalogue: effects to consider (default: the model's).
    max_effects: the most that are added, one at a time, all parameters refitted each time.
    jobs: processes.
    max_seconds: of longer recordings the windows with most motion are used.
    seed: of the robots drawn for the null distribution.
    progress: is called as the work advances.
    refit_cache: a file that keeps finished refits, so that an interrupted diagnosis continues where it stopped.
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
                    np.random.default_rng(0 if seed is None else seed), RefitCache(refit_cache, model, [*train, *test], catalogue))  # fmt: skip
    with ended_workers():
        problem, fit = fit_least_squares(model, train, progress=search.progress)
        search.unit = problem.signals.unit or "rad"
        calibrated = finish(problem, fit, 0.0)
        search.rollouts += problem.rollouts
        base = evaluate(calibrated.model, test)
        search.progress("drawing faultless robots", 0, held_out_error=search.milli(base.error))
        null = draw_null(calibrated.model, fit, problem, test, search.rng)
        search.rollouts += null.rollouts
        p_value = null.p_value(base.chi2)
        screened = screen_all(search, problem, fit, null, first=True)
        state = SearchState((calibrated.model, problem, fit), base, null)
        if p_value < ALARM:
            state = search_effects(search, state, screened, max_effects)
    final = finish(state.current[1], state.current[2], 0.0, state.null.parameter_sd)
    return summarise(
        verdict=_verdict(p_value, state), model=model, calibrated=calibrated, final=final, steps=state.steps,
        tie=state.tie, closest=state.closest, base=base, held=state.held, null=state.null, p_value=p_value,
        ranking=search.ranking, unobservable=search.unobservable, catalogue=catalogue, test=all_test, rollouts=search.rollouts,
        seconds=time.perf_counter() - begun,
    )  # fmt: skip


def _verdict(p_value: float, state: SearchState) -> str:
    if p_value >= ALARM:
        return "nothing_missing"
    if not state.steps or not is_convincing(state.base, state.held, state.null.chi2):
        return "unknown"
    return "ambiguous" if state.tie else "missing"
