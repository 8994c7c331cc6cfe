"""Refit: a model with one more effect, all parameters fitted again, judged on held-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from embodiedreamer_gym.diagnosis.effect_starts import best_by_joint, recombine, sizes_of, start_of
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, pooled, summarise_errors
from embodiedreamer_gym.diagnosis.refit_cache import CachedFit
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.least_squares import BEHIND, Fit, fit_at, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel

ITERATIONS = 12
TOLERANCE = 1e-3
STUCK = 1.4  # chi2 of a joint above which a fit may have ended in a wrong valley
CLEARLY = 0.05  # of a joint's chi2, by which one fit is better there than another
FINAL_ITERATIONS, FINAL_TOLERANCE = 25, 1e-4
NEGLIGIBLE_LOSS = 0.08  # of held-out score, below which an effect is removed from a joint
RULES = ("linear", "hold")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A refitted model: the effect added last, its fit, and how it does on the held-out recordings."""

    kind: type[Effect]
    model: RobotModel
    problem: Problem
    fit: Fit
    held_out: HeldOut
    rollouts: int

    @cached_property
    def trained(self) -> HeldOut:
        """How the model does on the recordings that it was fitted to."""
        return summarise_errors(self.problem.signals, self.fit.residuals)

    @cached_property
    def judged(self) -> HeldOut:
        """Error by which the effect is accepted, see `judged`."""
        return judged(self.problem, self.trained, self.held_out)

    @property
    def trained_score(self) -> float:
        """The score of a `HeldOut`, on the training recordings."""
        return self.trained.score


def judged(problem: Problem, trained: HeldOut, held_out: HeldOut) -> HeldOut:
    """Error by which effects are accepted: on all motion, or on held-out motion alone where efforts are compared.

    Fits to efforts estimate masses as well, as many parameters as the fitted motion bears.
    """
    return held_out if problem.signals.by_effort else pooled(trained, held_out)


def refit(
    base: RobotModel, screened: Screened, problem: Problem, train: Sequence[Recording], test: Sequence[Recording],
    both_rules: bool, rival: float = np.inf, cached: CachedFit | None = None,
) -> Candidate:  # fmt: skip
    """Fit base + effect from several starts; under both rules between commands where the recordings name none.

    problem: the base model's own, whose rule between commands is kept; rival: cost of another refit, far above which this
    one is given up; cached: where this refit ended once before.
    """
    trial = base.with_effect(screened.kind, screened.joints)
    options = RULES if both_rules and screened.kind.stage == "command" else (problem.hold,)
    if cached is not None:
        options = (cached.hold,)
    fits: list[Candidate] = []
    for hold in options:
        new = Problem(trial, train, hold=hold)
        if cached is None:
            fit = _from_starts(new, screened, trial, rival)
        elif len(cached.x) == len(new.rows):
            fit = fit_at(new, cached.x)
        else:
            raise CalibrationError(f"the refit cache does not fit {screened.kind.name}; give another file.")
        model = new.model_at(fit.x)
        fits.append(Candidate(screened.kind, model, new, fit, evaluate(model, test, hold), new.rollouts))
    best = min(fits, key=lambda c: c.fit.cost)
    return replace(best, rollouts=sum(c.rollouts for c in fits))


def _from_starts(problem: Problem, screened: Screened, trial: RobotModel, rival: float) -> Fit:
    """Fit from the best of several sizes joint by joint; where a joint stays above its noise also from the screening's start.

    Then what each fit found best is recombined joint by joint, and fitted again.
    """
    first = start_of(problem, screened.start)
    sizes = sizes_of(screened.kind, trial, screened.start)
    gains = [{}, screened.nominal] if screened.nominal else [{}]
    starts = [first, *(start_of(problem, {**size, **gain}) for gain in gains for size in sizes)]
    fit = minimise(problem, best_by_joint(problem, starts), ITERATIONS, TOLERANCE, rival=rival)
    chi2 = problem.joint_rms(fit.residuals)[0] ** 2
    if problem.signals.by_effort or chi2.max() <= STUCK or fit.cost > rival + BEHIND:
        return fit
    other = minimise(problem, first, ITERATIONS, TOLERANCE, rival=min(fit.cost, rival))
    both = np.stack([chi2, problem.joint_rms(other.residuals)[0] ** 2])
    fits = [fit, other]
    if (both[1] < both[0] - CLEARLY).any() and (both[0] < both[1] - CLEARLY).any():
        mixed = recombine(problem, np.stack([fit.x, other.x]), both)
        fits.append(minimise(problem, mixed, ITERATIONS, TOLERANCE, rival=min(f.cost for f in fits)))
    return min(fits, key=lambda f: f.cost)


def prune(
    candidate: Candidate, train: Sequence[Recording], test: Sequence[Recording], share: float = 0.1
) -> Candidate:  # fmt: skip
    """Keep the effect only on the joints (or arms) where switching it off costs held-out score, and refit.

    A joint stays when switching it off alone loses more than `share` of the largest loss of a joint, both with the other
    parameters as they are and with them refitted (linearly); the latter alone counts where held-out motion depends on no
    joint, as for a limit that it does not reach. The smaller effect is taken unless it does worse on held-out recordings.
    """
    kind, model = candidate.kind, candidate.model
    effect = next(e for e in model.effects if e.name == kind.name)
    places = sorted({place for values in effect.values.values() for place in values}, key=_order(model))
    if len(places) < 2:
        return candidate
    losses, refitted_losses = [], []
    for place in places:
        values = {
            ParameterKey(p.name, kind.name): {place: float(model.parameter_off(p)[model.places(p).index(place)])}
            for p in kind.parameters if place in model.places(p)
        }  # fmt: skip
        off = evaluate(model.with_values(values), test, candidate.problem.hold)
        refitted_losses.append(_refitted_loss(candidate, place))
        losses.append(min(off.score - candidate.held_out.score, refitted_losses[-1]))
    keep = _above(places, losses, share) or _above(places, refitted_losses, share)
    spent = candidate.rollouts + len(places)
    if not keep or len(keep) == len(places):
        return replace(candidate, rollouts=spent)
    smaller = kind(**{k: {j: v for j, v in values.items() if j in keep} for k, values in effect.values.items()})
    trimmed = model.with_(effects=(*(e for e in model.effects if e.name != kind.name), smaller))
    new = Problem(trimmed, train, hold=candidate.problem.hold)
    fit = minimise(new, new.start, ITERATIONS, TOLERANCE)
    fitted = new.model_at(fit.x)
    held_out = evaluate(fitted, test, new.hold)
    spent += new.rollouts
    if held_out.score > candidate.held_out.score + NEGLIGIBLE_LOSS * (len(places) - len(keep)):
        return replace(candidate, rollouts=spent)
    return Candidate(kind, fitted, new, fit, held_out, spent)


def _above(places: Sequence[str], losses: Sequence[float], share: float) -> list[str]:
    """Places whose loss is not negligible beside the largest."""
    return [p for p, loss in zip(places, losses, strict=True) if loss > max(share * max(losses), NEGLIGIBLE_LOSS)]


def _refitted_loss(candidate: Candidate, place: str) -> float:
    """Loss of training score when the effect is off at one joint (or arm) and the others are refitted.

    Half the squared distance from off in units of the estimate's covariance, whose Hessian is that of the sum over
    joints of log(1 + chi2). It overestimates the loss of an effect that is off at a distant bound (a limit).
    """
    problem, fit = candidate.problem, candidate.fit
    keys = [row.key for row in problem.rows]
    own = np.array([i for i, key in enumerate(keys) if (key.effect, key.place) == (candidate.kind.name, place)], int)
    off = problem.scale(np.array([r.value if r.off is None else r.off for r in problem.rows]))[own]
    weighted = fit.jacobian * (fit.weight / np.sqrt(problem.joint_counts[problem.joint_of]))[:, None]
    free = (fit.x > problem.lower + 1e-9) & (fit.x < problem.upper - 1e-9)
    free[own] = False
    own_part, others = weighted[:, own], weighted[:, free]
    left = own_part - others @ np.linalg.lstsq(others, own_part, rcond=1e-6)[0]
    return 0.5 * float(np.sum((left @ (fit.x[own] - off)) ** 2))


def polish(candidate: Candidate, test: Sequence[Recording]) -> Candidate:
    """Continue a refit to a finer tolerance, so that no later effect makes up for it."""
    problem = candidate.problem
    spent = problem.rollouts
    fit = minimise(problem, candidate.fit.x, FINAL_ITERATIONS, FINAL_TOLERANCE)
    model = problem.model_at(fit.x)
    held_out = evaluate(model, test, problem.hold)
    return replace(
        candidate, model=model, fit=fit, held_out=held_out, rollouts=candidate.rollouts + problem.rollouts - spent
    )


def _order(model: RobotModel):
    names = (*model.joints, *model.arms)
    return names.index
