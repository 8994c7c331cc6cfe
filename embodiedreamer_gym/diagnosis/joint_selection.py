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
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.intervals import spread
from embodiedreamer_gym.phys_aligner.least_squares import Fit, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

CHANCE = float(chi2.sf(3.0**2, 1))  # of a joint without the effect to be kept: that of three standard deviations
REWEIGHTED = 3  # refits of the parameters that are left, each with the weights of the one before


def select_joints(candidate: Candidate, train: Sequence[Recording], test: Sequence[Recording]) -> Candidate:
    """Keep an effect only on the joints that show it, and fit all parameters again; one of arms stays as it is."""
    kind = candidate.kind
    if all(p.per == "arm" for p in kind.parameters):
        return candidate
    hold, before = candidate.problem.hold, candidate.model
    present = _effect(before, kind)
    full = Problem(_with(before, _on_all_joints(before, present)), train, hold=hold)
    problem, fit = fit_with_robot_errors(full, full.start, [*train, *test])
    keep = joints_that_show(kind, problem, fit)
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


def joints_that_show(kind: type[Effect], problem: Problem, fit: Fit) -> set[str]:
    """Joints (or arms) of a fit where an effect of the catalogue is significantly different from off.

    By the squared distance from off in units of the estimate's covariance (Wald's test); where a parameter has no
    covariance, as on a bound, or off is a limit that nothing reaches, by the likelihood ratio of a fit without it there.
    """
    uncertainty = spread(problem, fit.x, fit.residuals * fit.weight, fit.jacobian * fit.weight[:, None])
    off = problem.scale(np.array([row.value if row.off is None else row.off for row in problem.rows]))
    parameters = {p.name: p for p in kind.parameters}
    found, doubtful = set(), {}
    for place in dict.fromkeys(row.key.place for row in problem.rows if row.key.effect == kind.name):
        own = [i for i, row in enumerate(problem.rows) if (row.key.effect, row.key.place) == (kind.name, place)]
        named = [parameters[problem.rows[i].key.parameter] for i in own]
        sized = [i for i, p in zip(own, named, strict=True) if not p.shape and abs(fit.x[i] - off[i]) > 1e-9]
        covariance = uncertainty.covariance[np.ix_(sized, sized)]
        if not sized:
            continue
        if np.isnan(covariance).any() or any(p.off == p.high for p in named):
            doubtful[place] = own
            continue
        distance = fit.x[sized] - off[sized]
        if chi2.sf(distance @ np.linalg.pinv(covariance, hermitian=True) @ distance, len(sized)) < CHANCE:
            found.add(place)
    if doubtful:
        ratios = _likelihood_ratios(problem, fit, off, list(doubtful.values()))
        found |= {
            p for (p, own), ratio in zip(doubtful.items(), ratios, strict=True) if chi2.sf(ratio, len(own)) < CHANCE
        }
    return found


def _likelihood_ratios(problem: Problem, fit: Fit, off: np.ndarray, groups: Sequence[list[int]]) -> list[float]:
    """2 x fall of the log-likelihood when each group of parameters is off and the others are refitted, linearly.

    Of residuals whose size is unknown joint by joint, of which `independent` is the share that counts.
    """
    trials = np.repeat(fit.x[None], len(groups), axis=0)
    for trial, own in zip(trials, groups, strict=True):
        trial[own] = off[own]
    free = (fit.x > problem.lower + 1e-9) & (fit.x < problem.upper - 1e-9)
    present = problem.joint_mean(fit.residuals**2)
    ratios = []
    for r, own in zip(problem.residuals(trials), groups, strict=True):
        others = np.flatnonzero(free & ~np.isin(np.arange(len(free)), own))
        jacobian, prior = fit.jacobian[:, others], 2.0 / problem.independent * problem.prior[others]
        left, step = r, np.zeros(len(others))
        for _ in range(REWEIGHTED):
            root = np.sqrt(2.0 / (1.0 + problem.joint_mean(left**2)))[problem.joint_of]
            j = jacobian * root[:, None]
            normal = j.T @ j + np.diag(prior)
            gradient = j.T @ (r * root) + prior * (fit.x - problem.centre)[others]
            step = -np.linalg.lstsq(normal, gradient, rcond=1e-10)[0]
            left = r + jacobian @ step
        away = (fit.x - problem.centre)[others]
        rise = float(np.sum(problem.prior[others] * ((away + step) ** 2 - away**2)))
        seen = problem.joint_counts > 0
        fall = np.log(problem.joint_mean(left**2)[seen] / np.maximum(present[seen], 1e-12))
        ratios.append(rise + problem.independent * float(problem.joint_counts[seen] @ fall))
    return ratios


def _effect(model: RobotModel, kind: type[Effect]) -> Effect:
    """The effect of this kind that a model has."""
    return next(effect for effect in model.effects if effect.name == kind.name)


def _with(model: RobotModel, effect: Effect) -> RobotModel:
    """The model with another effect of the same name in its place."""
    return model.with_(effects=(*(e for e in model.effects if e.name != effect.name), effect))


def _on_all_joints(model: RobotModel, effect: Effect) -> Effect:
    """The effect on all joints, off where it was not; its shapes are there as they are on the others in the median."""
    values = {}
    for p in effect.parameters:
        own, off = effect.values[p.name], zip(model.places(p), model.parameter_off(p), strict=True)
        usual = float(np.median(list(own.values()))) if p.shape and own else None
        values[p.name] = {place: own.get(place, float(away) if usual is None else usual) for place, away in off}
    return type(effect)(**values)
