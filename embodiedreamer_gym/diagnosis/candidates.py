"""Refits: add one more effect to a model, fit all parameters again, and evaluate on held-out recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from embodiedreamer_gym.diagnosis.effect_starts import Starts, Values, fitted_values, single_starts, start_of
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, pooled, summarise_errors
from embodiedreamer_gym.diagnosis.limits import limit_starts, release_limits
from embodiedreamer_gym.diagnosis.refit_cache import CachedFit
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.shapes import shape_starts
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.calibration import STUCK
from embodiedreamer_gym.phys_aligner.least_squares import BEHIND, Fit, cost_of, fit_at, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.starts import COARSE, piecewise_start
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

ITERATIONS = 12
EARLY = 3  # iterations after which only the most promising refits continue
TOLERANCE = 1e-3
LONG = 0.03  # step of the derivatives, in scaled units, that passes over the small local minima of a law that jumps
SMOOTH = 0.2  # relative change of the derivatives from the usual step to LONG up to which a law is smooth
FINAL_ITERATIONS, FINAL_TOLERANCE = 25, 1e-4
RULES = ("linear", "hold")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A refitted model: the effect that was added last, the fit, and the errors on the held-out recordings."""

    kind: type[Effect]
    model: RobotModel
    problem: Problem
    fit: Fit
    held_out: HeldOut
    rollouts: int

    @cached_property
    def trained(self) -> HeldOut:
        """Errors on the recordings that the model was fitted to."""
        return trained_errors(self.model, self.problem, self.fit)

    @cached_property
    def judged(self) -> HeldOut:
        """Errors on fitted and held-out recordings together, which decide whether the effect is accepted."""
        return pooled(self.trained, self.held_out)

    @property
    def trained_score(self) -> float:
        """Score (see `HeldOut.score`) on the training recordings."""
        return self.trained.score


def trained_errors(model: RobotModel, problem: Problem, fit: Fit) -> HeldOut:
    """Errors of a model on the recordings that it was fitted to; for efforts, in units of this model's noise."""
    if problem.signals.by_effort:
        return evaluate(model, problem.recordings)
    return summarise_errors(problem.signals, fit.residuals)


@dataclass(frozen=True, eq=False)
class Trial:
    """A planned refit: the model with one or two more effects, the starts, and the rules between commands to try.

    kind: the effect added last; again: a further start, tried if a joint stays above its noise; turn: distinguishes
    trials of the same effects.
    """

    kind: type[Effect]
    model: RobotModel
    starts: Starts
    holds: tuple[str | None, ...]
    again: Values | None = None
    turn: int = 0

    @property
    def name(self) -> str:
        """Names of all effects."""
        return "+".join(e.name for e in self.model.effects)


def single_trial(base: RobotModel, screened: Screened, hold: str | None, both_rules: bool) -> Trial:
    """The trial of one more effect, which starts from the screening's values and from several sizes.

    both_rules: whether an effect on commands is tried under both rules between commands, because the recordings name
    none.
    """
    model = base.with_effect(screened.kind, screened.joints)
    starts = single_starts(screened.kind, model, screened.start, screened.nominal)
    holds = RULES if both_rules and screened.kind.stage == "command" else (hold,)
    return Trial(screened.kind, model, starts, holds, screened.start)


def at_gains_of(trial: Trial, other: Candidate) -> Trial:
    """The trial, with starts at the servo's gains of another fit."""
    gains = {key: value for key, value in fitted_values(other.model).items() if not key.effect}
    sizes = tuple({**{key: v for key, v in one.items() if key.effect}, **gains} for one in trial.starts.first)
    return replace(trial, starts=replace(trial.starts, first=sizes, apart=()), again=None)


def begin_refit(trial: Trial, train: Sequence[Recording], test: Sequence[Recording], iterations: int) -> Candidate:
    """Run the first iterations of a refit from the best of its starts, with a coarser simulation step."""
    begun = []
    for hold in trial.holds:
        coarse = Problem(trial.model, train, hold=hold, dt=COARSE)
        for start in trial.starts.all(coarse):
            begun.append((minimise(coarse, start, iterations, TOLERANCE, derivatives=False), coarse))
    fit, coarse = min(begun, key=lambda one: one[0].cost)
    problem = Problem(trial.model, train, hold=coarse.hold)
    residuals = problem.residuals(fit.x)[0]
    problem.rollouts += sum(c.rollouts for c in {id(c): c for _, c in begun}.values())
    return as_candidate(
        trial.kind, problem, replace(fit, residuals=residuals, cost=cost_of(problem, fit.x, residuals)), test
    )


def finish_refit(
    trial: Trial, begun: Candidate, test: Sequence[Recording], iterations: int, rival: float = np.inf
) -> Candidate:  # fmt: skip
    """Continue a refit; if a joint stays above its noise, also from other starts, see `leave_valley`.

    rival: cost of another refit; this one is given up if its cost is far above.
    """
    problem, spent = begun.problem, begun.problem.rollouts
    fit = minimise(problem, begun.fit.x, iterations, TOLERANCE, rival=rival)
    if fit.cost <= rival + BEHIND:
        further = [start_of(problem, trial.again)] if trial.again else []
        fit = leave_valley(problem, fit, further, rival)
    done = as_candidate(trial.kind, problem, release_limits(problem, fit), test)
    return replace(done, rollouts=begun.rollouts + problem.rollouts - spent)


def leave_valley(problem: Problem, fit: Fit, further: Sequence[np.ndarray] = (), rival: float = np.inf) -> Fit:
    """Repeat a fit from other starts, one after the other, until no joint is above its noise.

    The starts: other sizes of the limits; the result of a fit with longer steps of the derivatives, unless the law is
    smooth; other shapes; fits to pieces of the motion.

    further: starts (m,) that are also tried on pieces of the motion; rival: see `finish_refit`.
    """
    if problem.signals.by_effort:
        return fit  # efforts are not integrated over time, so there are no local minima
    starts: tuple[Callable[[Fit, np.ndarray], np.ndarray | None], ...] = (
        lambda f, stuck: _best(problem, limit_starts(problem, f.x, stuck)),
        lambda f, _: None if _is_smooth(problem, f) else _long_steps(problem, f.x),
        lambda f, stuck: _best(problem, shape_starts(problem, f.x, stuck)),
        lambda f, _: piecewise_start(problem, [f.x, *further]),
    )
    for start in starts:
        stuck = problem.joint_rms(fit.residuals)[0] ** 2 > STUCK
        if not stuck.any():
            break
        x = start(fit, stuck)
        if x is not None:
            other = minimise(problem, x, ITERATIONS, TOLERANCE, rival=min(fit.cost, rival))
            fit = min(fit, other, key=lambda f: f.cost)
    return fit


def _long_steps(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Result (m,) of a fit from scaled parameters (m,) with derivatives over long steps."""
    return minimise(problem, x, ITERATIONS, TOLERANCE, derivatives=False, step=LONG).x


def _is_smooth(problem: Problem, fit: Fit) -> bool:
    """Whether derivatives over long steps are similar to those of a fit, so that no small local minimum is near."""
    long = problem.jacobian(fit.x, LONG)[1]
    change, size = (np.linalg.norm(j, axis=0) for j in (long - fit.jacobian, fit.jacobian))
    return bool((change <= SMOOTH * size).all())


def _best(problem: Problem, starts: Starts | None) -> np.ndarray | None:
    """The best of the starts, if there are any."""
    return None if starts is None else starts.best(problem)


def refit(trial: Trial, train: Sequence[Recording], test: Sequence[Recording]) -> Candidate:
    """Run a refit from the start to the end."""
    return finish_refit(trial, begin_refit(trial, train, test, EARLY), test, ITERATIONS - EARLY)


def resume_refit(trial: Trial, cached: CachedFit, train: Sequence[Recording], test: Sequence[Recording]) -> Candidate:
    """Restore a finished refit from the cache.

    Raises: CalibrationError if it belongs to another model.
    """
    problem = Problem(trial.model, train, hold=cached.hold)
    if len(cached.x) != len(problem.rows):
        raise CalibrationError(f"the refit cache does not match the model with {trial.name}; give another file.")
    return as_candidate(trial.kind, problem, fit_at(problem, cached.x), test)


def as_candidate(kind: type[Effect], problem: Problem, fit: Fit, test: Sequence[Recording]) -> Candidate:
    """A finished fit with its errors on the held-out recordings."""
    model = problem.model_at(fit.x)
    return Candidate(kind, model, problem, fit, evaluate(model, test, problem.hold), problem.rollouts)


def polish(candidate: Candidate, test: Sequence[Recording]) -> Candidate:
    """Continue a refit to a finer tolerance, so that no later effect compensates for an unfinished fit."""
    problem = candidate.problem
    spent = problem.rollouts
    fit = minimise(problem, candidate.fit.x, FINAL_ITERATIONS, FINAL_TOLERANCE)
    model = problem.model_at(fit.x)
    held_out = evaluate(model, test, problem.hold)
    return replace(
        candidate, model=model, fit=fit, held_out=held_out, rollouts=candidate.rollouts + problem.rollouts - spent
    )
