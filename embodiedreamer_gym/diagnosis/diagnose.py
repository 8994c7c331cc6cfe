"""diagnose: calibrate, test whether the model is wrong, add effects that lower the held-out error, give a verdict."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import FINAL_ITERATIONS, FINAL_TOLERANCE, trained_errors
from embodiedreamer_gym.diagnosis.coupled_motors import coupling_notes
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis, summarise
from embodiedreamer_gym.diagnosis.error_ceiling import explainable_shares
from embodiedreamer_gym.diagnosis.explainable import explainable_chi2
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.notes import notes_on
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.diagnosis.search import search_effects
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState, screen_all
from embodiedreamer_gym.diagnosis.unseen_motion import learn_from_worst, only_held_out_shows
from embodiedreamer_gym.diagnosis.verdict import (
    ALARM,
    EXACT,
    EXPLAINED,
    FAR,
    INEXACT,
    JUDGEABLE,
    MOSTLY,
    NEARLY,
    explained,
    is_convincing,
    is_far_from_noise,
    total_explainable,
    total_explained,
)
from embodiedreamer_gym.diagnosis.wording import Attempt
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.effects.rotor_inertia import RotorInertia
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.parallel import ended_workers
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares, with_nuisances
from embodiedreamer_gym.phys_aligner.evidence import log_evidence
from embodiedreamer_gym.phys_aligner.least_squares import Fit, minimise
from embodiedreamer_gym.phys_aligner.linear_baseline import least_squares_rms
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.signals import with_effort_scale, with_effort_unit
from embodiedreamer_gym.recordings import Recording, as_recordings, thin
from embodiedreamer_gym.robot import RobotModel

ODDS = 10.0  # odds to one from which an effect is named rather than errors of the URDF
WORSE = 1.25  # multiple of the error of plain least squares above which the effects found are rejected
MAX_SECONDS = 80.0  # s of motion for fitting, and as much for testing


@renamed_arguments(rng="seed", journal="refit_cache")
def diagnose(
    model: RobotModel,
    train: Recording | Sequence[Recording],
    test: Recording | Sequence[Recording],
    catalogue: Mapping[str, type[Effect]] | None = None,
    max_effects: int = 3,
    jobs: int = 2,
    max_seconds: float = MAX_SECONDS,
    seed: int | np.random.Generator = 0,
    progress: ProgressCallback | None = None,
    refit_cache: str | Path | None = None,
) -> Diagnosis:
    """Find out which physical effects a model lacks, by free-run error on held-out recordings.

    The model is calibrated first. Errors are reported for the complete held-out recordings.

    train, test: recordings for fitting, and held-out recordings for testing.
    catalogue: effects to consider (default: the model's).
    max_effects: largest number of effects, added one at a time; all parameters are refitted each time.
    jobs: number of processes.
    max_seconds: of motion used from `train` and from `test`; of longer recordings, the windows with the most motion.
    seed: of the robots drawn for the null distribution.
    progress: is called as the work advances.
    refit_cache: a file that keeps finished refits, so that an interrupted diagnosis continues where it stopped.
    Raises: CalibrationError or SimulationError if the recordings do not fit the model.
    """
    begun, train, test = time.perf_counter(), as_recordings(train), as_recordings(test)
    if not train or not test:
        raise CalibrationError(
            "diagnose needs recordings for fitting (train) and held-out recordings for testing (test)."
        )
    logs = with_effort_unit(model, [*train, *test])
    train, test = logs[: len(train)], logs[len(train) :]
    model = with_effort_scale(model, train)
    train_logs, all_test, train, test = train, test, thin(train, max_seconds), thin(test, max_seconds)
    both = model.command_hold == "unknown" and any(r.command_hold == "unknown" for r in train)
    catalogue = catalogue or model.catalogue
    search = Search(model, train, test, catalogue, jobs, progress_or_silence(progress), both,
                    np.random.default_rng(0 if seed is None else seed), RefitCache(refit_cache, model, [*train, *test], catalogue),
                    whole_test=all_test)  # fmt: skip
    with ended_workers():
        result, moved = _attempt(search, model, max_effects, len(all_test) > 1), None
        if result.verdict == "unknown" or result.state.needs_all_motion or result.state.unseen:
            moved = learn_from_worst(search, result.state, train_logs, max_seconds)
        if moved is not None:
            search = moved[0]
            search.progress(f"adding {moved[1].name} to the training recordings", 0)
            result = _attempt(search, model, max_effects)
        looser = with_nuisances(model, search.train)
        if looser is not model and not _stands(search, result):
            search.progress("estimating the URDF's masses", 0)
            other = _attempt(search, looser, max_effects)
            if not (result.verdict != "unknown" and len(result.state.steps) > 1 and other.verdict == "unknown"):
                result = other
    baseline, notes = None, notes_on(model, logs)
    if result.state.by_effort:
        baseline = float(np.nanmean(least_squares_rms(model, train, all_test)))
        notes += coupling_notes(result.final.model, train, test)
        notes += _risen(search, result)
    if moved is not None:
        notes += (
            f"Note: only held-out motion shows the error, so {moved[1].name} was moved to the training recordings; "
            "the others remain for testing.",
        )
    return summarise(
        result, model=model, ranking=search.ranking, unobservable=search.unobservable, catalogue=catalogue, test=search.whole_test,
        rollouts=search.rollouts, seconds=time.perf_counter() - begun, baseline=baseline,
        notes=notes, learned_from=() if moved is None else (moved[1].name,),
    )  # fmt: skip


def _risen(search: Search, result: Attempt) -> tuple[str, ...]:
    """A note if the named effect lowers the error of efforts only on the training motion."""
    state = result.state
    if result.verdict == "unknown" or state.held.error <= state.base.error:
        return ()
    was, now = search.milli(state.trained.error), search.milli(state.fitted.error)
    noisier = bool((state.held.sigma > state.base.sigma).any())
    reason = " because a model with this inertia turns more of the position's noise into effort" if noisier else ""
    return (f"Note: the held-out error rises{reason}; on the training motion the error falls from {was} to {now}.",)


def _explainable(search: Search, state: SearchState) -> np.ndarray | None:
    """Share of the calibrated error that a general regression predicts.

    None for efforts, or if the effects bring most joints near their noise.
    """
    model, problem, _ = state.start
    if problem.signals.by_effort or np.median(state.held.chi2) <= FAR:
        return None
    return explainable_shares(model, search.whole_test, problem.hold)


def _stands(search: Search, result: Attempt) -> bool:
    """Whether a verdict with the URDF's own masses is final: no effect, or one that wrong masses do not explain.

    The effect must be more probable than no effect and than its special cases in fits that also estimate the masses
    (and rotor inertias, unless the effect is one): a richer law may absorb the error that wrong masses leave with a
    simple law.
    """
    if result.verdict == "nothing_missing":
        return True
    if result.verdict == "unknown" or len(result.state.steps) > 1:
        return False
    without = result.calibrated.model
    (effect,) = [e for e in result.final.model.effects if not without.has_effect(type(e))]
    places = tuple({place for values in effect.values.values() for place in values})
    special_cases = [search.catalogue[name] for name in type(effect).generalises if name in search.catalogue]
    rivals = [without, *(without.with_effect(kind, places) for kind in special_cases if not without.has_effect(kind))]
    given = without.given - ({"rotor_inertia"} if not isinstance(effect, RotorInertia) else set())
    *least, named = (_evidence(search, model.with_(given=given)) for model in [*rivals, result.final.model])
    return named > max(least) + np.log(ODDS)


def _evidence(search: Search, model: RobotModel) -> float:
    """Logarithm of the evidence of a model whose masses are estimated."""
    problem = Problem(model.with_effect(InertialError), search.train)
    fit = minimise(problem, problem.start, progress=search.progress)
    search.rollouts += problem.rollouts
    return log_evidence(problem, fit)


def _attempt(search: Search, model: RobotModel, max_effects: int, needs_motion: bool = False) -> Attempt:
    """Calibrate a model, test whether it is wrong, and search for the effects that it lacks.

    Two rules apply if efforts are compared. With the URDF's own masses (2 % off), an effect is named only if it leaves
    nothing to explain. In any case, no effect is named if plain least squares has a much smaller error without it.

    needs_motion: whether to skip the search if only held-out motion shows an error.
    """
    search.ranking = []
    problem, fit = fit_least_squares(model, search.train, progress=search.progress)
    search.unit = problem.signals.unit or "rad"
    calibrated = finish(problem, fit, 0.0)
    search.rollouts += problem.rollouts
    base = evaluate(calibrated.model, search.test)
    search.progress("drawing faultless robots", 0, held_out_error=search.milli(base.error))
    null = draw_null(calibrated.model, fit, problem, search.test, search.rng)
    search.rollouts += null.rollouts
    trained = trained_errors(calibrated.model, problem, fit)
    p_value = null.p_value(base.chi2, trained.chi2)
    state = SearchState((calibrated.model, problem, fit), base, trained, null)
    if p_value < ALARM and needs_motion and only_held_out_shows(state):
        return Attempt("unknown", calibrated, calibrated, state, p_value)
    screened = screen_all(search, problem, fit, null, first=True)
    verdict, shares = "nothing_missing", None
    if p_value < ALARM:
        state = search_effects(search, state, screened, max_effects)
        shares = _explainable(search, state)
        estimated = model.has_effect(InertialError)
        if not problem.signals.by_effort:
            convincing = _fits_all_motion(search, state, shares)
        elif not estimated:
            convincing = state.is_exact
        else:
            explainable = explainable_chi2(calibrated.model, search.train, search.test)
            convincing = is_convincing(base, state.held, state.null.chi2, explainable)
        if convincing and problem.signals.by_effort:
            plain = float(np.nanmean(least_squares_rms(model, search.train, search.test)))
            convincing = state.held.error <= WORSE * plain
        verdict = "unknown" if not state.steps or not convincing else "ambiguous" if state.tie else "missing"
    _, problem, fit = state.current
    wider = fit_with_robot_errors(problem, fit.x, [*search.train, *search.test])
    search.rollouts += wider[0].rollouts
    final = finish(problem, fit, 0.0, wider)
    return Attempt(verdict, calibrated, final, state, p_value, shares)


def _explains_excess(state: SearchState) -> bool:
    """Whether the effects explain most of the calibrated model's excess error, on the fitted or on held-out motion."""
    null, held = state.start_null, state.held if state.together is None else state.together[1]
    return max(total_explained(state.base, held, null.chi2),
               total_explained(state.trained, state.fitted, null.trained_chi2)) >= EXPLAINED  # fmt: skip


def _outlasts_masses(search: Search, state: SearchState) -> bool:
    """Whether the effects leave little error where wrong masses show so clearly that they could explain any error.

    An example is a drive at its limit. In this case, the errors on the fitted motion are taken from a fit that also
    estimates masses, centres of mass and friction. A single effect may instead explain nearly all of the error at every
    joint: if a law jumps, the motion is so sensitive that even the right effect leaves more than a little.
    """
    if state.most.max() <= JUDGEABLE:
        return True
    single, last = len(state.steps) == 1, state.steps[-1]
    if single:
        share = explained(state.judged_start, state.judged, state.start_null.chi2)
        if np.nanmin(share, initial=1.0) >= NEARLY:
            return True
    problem, fit = fit_with_robot_errors(last.problem, last.fit.x, search.train, derivatives=False)
    least = np.minimum((INEXACT if single else EXACT) * state.most, JUDGEABLE)
    if not _leaves_little(problem, fit, least):  # a few more iterations
        fit = minimise(problem, fit.x, FINAL_ITERATIONS, FINAL_TOLERANCE, derivatives=False)
    search.rollouts += problem.rollouts
    return _leaves_little(problem, fit, least)


def _leaves_little(problem: Problem, fit: Fit, most: np.ndarray) -> bool:
    """Whether the chi2 of each joint is at most `most` (n,)."""
    return bool((problem.joint_rms(fit.residuals)[0] ** 2 <= most).all())


def _fits_all_motion(search: Search, state: SearchState, shares: np.ndarray | None) -> bool:
    """Whether the effects leave no more error than faultless robots have on all motion, and explain most of the excess.

    A single effect may leave a little more. An alarm by chance leaves little to explain, and an effect that explains
    none of it is not its cause. Logs far above the noise are judged by the explained share of the error, relative to
    the share that a general regression predicts (shares).
    """
    if not state.steps:
        return False
    much = total_explained(state.judged_start, state.judged, state.null.chi2) >= EXPLAINED
    inexact = len(state.steps) == 1 and state.excess <= INEXACT and much
    if (state.is_exact or inexact) and _explains_excess(state) and _outlasts_masses(search, state):
        return True
    errors = (state.base, state.held, state.start_null.chi2)
    if not is_far_from_noise(*errors):
        return False
    return shares is None or total_explained(*errors) >= MOSTLY * total_explainable(*errors, shares[:, -1])
