"""Joint selection: the joints on which an effect differs from off by more than its uncertainty.

The effect is fitted on all joints, to all recordings, with the robot's errors beside; a wrong mass bends an effect's
parameters on joints that do not have it, and residuals alone do not show that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, TOLERANCE, Candidate
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.diagnosis.screening import largest_seen
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.intervals import coloured_covariance, spread
from embodiedreamer_gym.phys_aligner.least_squares import Fit, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

CHANCE = 0.0027  # of a joint without the effect to be kept: that of three standard deviations


def select_joints(candidate: Candidate, train: Sequence[Recording], test: Sequence[Recording]) -> Candidate:
    """Keep an effect only on the joints that show it, and fit all parameters again; one of arms stays as it is."""
    kind = candidate.kind
    if all(p.per == "arm" for p in kind.parameters):
        return candidate
    hold, before = candidate.problem.hold, candidate.model
    present = _effect(before, kind)
    full = Problem(_with(before, _on_all_joints(before, present, candidate.problem)), train, hold=hold)
    problem, fit = fit_with_robot_errors(full, full.start, [*train, *test])
    keep = {place for place, chance in significance(kind, problem, fit).items() if chance < CHANCE}
    spent = candidate.rollouts + full.rollouts + problem.rollouts
    places = {place for values in present.values.values() for place in values}
    if not keep or keep == places:
        return replace(candidate, rollouts=spent)
    fitted = _effect(problem.model_at(fit.x), kind)
    chosen = kind(**{name: {j: v for j, v in values.items() if j in keep} for name, values in fitted.values.items()})
    new = Problem(_with(before, chosen), train, hold=hold)
    refitted = minimise(new, new.start, ITERATIONS, TOLERANCE)
    model = new.model_at(refitted.x)
    return Candidate(kind, model, new, refitted, evaluate(model, test, hold), spent + new.rollouts)


def significance(kind: type[Effect], problem: Problem, fit: Fit) -> dict[str, float]:
    """Joint (or arm) -> the chance that an effect of a fit that is off there comes out as far from off as it does.

    By the squared distance from off in units of the estimate's covariance (Wald's test). Where a parameter has no
    covariance, as on a bound, or is a limit, whose off is infinitely far, by what a fit without the effect there leaves.
    """
    uncertainty = spread(problem, fit.x, fit.residuals * fit.weight, fit.jacobian * fit.weight[:, None])
    off = problem.scale(np.array([row.value if row.off is None else row.off for row in problem.rows]))
    parameters = {p.name: p for p in kind.parameters}
    chance: dict[str, float] = {}
    for place in dict.fromkeys(row.key.place for row in problem.rows if row.key.effect == kind.name):
        own = [i for i, row in enumerate(problem.rows) if (row.key.effect, row.key.place) == (kind.name, place)]
        named = [parameters[problem.rows[i].key.parameter] for i in own]
        sized = [i for i, p in zip(own, named, strict=True) if not p.shape and abs(fit.x[i] - off[i]) > 1e-9]
        covariance = uncertainty.covariance[np.ix_(sized, sized)]
        if not sized:
            chance[place] = 1.0
        elif np.isnan(covariance).any() or any(p.off == p.high for p in named):
            chance[place] = float(chi2.sf(_evidence(problem, fit, own, off), len(sized)))
        else:
            distance = fit.x[sized] - off[sized]
            chance[place] = float(chi2.sf(distance @ np.linalg.pinv(covariance, hermitian=True) @ distance, len(sized)))
    return chance


def _evidence(problem: Problem, fit: Fit, own: list[int], off: np.ndarray) -> float:
    """2 x fall of the log-likelihood when some parameters (rows `own`) are off and the others are refitted, linearly.

    What the residuals cannot answer is a direction in which they were measured, its variance that of coloured residuals;
    and the robot's errors move away from what is known beforehand.
    """
    trial = fit.x.copy()
    trial[own] = off[own]
    free = (fit.x > problem.lower + 1e-9) & (fit.x < problem.upper - 1e-9)
    free[own] = False
    prior, away = problem.prior[free], (fit.x - problem.centre)[free]
    jacobian, r = fit.jacobian[:, free] * fit.weight[:, None], problem.residuals(trial)[0] * fit.weight
    rows = np.vstack([jacobian, np.diag(np.sqrt(2.0 / problem.independent * prior))])
    change = r - fit.residuals * fit.weight
    step = -np.linalg.lstsq(rows, np.concatenate([change, np.zeros(len(prior))]), rcond=1e-8)[0]
    left = change + jacobian @ step
    variance = float(coloured_covariance(problem, fit.residuals * fit.weight, left[:, None])[0, 0])
    seen = float(left @ left) ** 2 / variance if variance > 0 else 0.0
    return seen + float(np.sum(prior * ((away + step) ** 2 - away**2)))


def _effect(model: RobotModel, kind: type[Effect]) -> Effect:
    """The effect of this kind that a model has."""
    return next(effect for effect in model.effects if effect.name == kind.name)


def _with(model: RobotModel, effect: Effect) -> RobotModel:
    """The model with another effect of the same name in its place."""
    return model.with_(effects=(*(e for e in model.effects if e.name != effect.name), effect))


def _on_all_joints(model: RobotModel, effect: Effect, problem: Problem) -> Effect:
    """The effect on all joints: off where it was not, but a limit at the largest value seen, where it begins to show.

    Its shapes are there as they are on the others in the median.
    """
    values = {}
    for p in effect.parameters:
        own, start = effect.values[p.name], model.parameter_off(p)
        if p.shape and own:
            start = np.clip(np.full(len(start), np.median(list(own.values()))), *model.parameter_bounds(p))
        elif p.off == p.high:
            start = np.clip(largest_seen(p.unit, model, problem), *model.parameter_bounds(p))
        values[p.name] = {place: own.get(place, float(v)) for place, v in zip(model.places(p), start, strict=True)}
    return type(effect)(**values)
