"""Refits of a diagnosis: choose the effects, refit them in two stages, and use the cache."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import (
    EARLY,
    ITERATIONS,
    Candidate,
    Trial,
    at_gains_of,
    begin_refit,
    finish_refit,
    refit,
    resume_refit,
    single_trial,
)
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, gain
from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.search_state import Ranked, Search
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.io.parallel import many
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import RobotModel

REFITS = 5  # best effects of the screening that are refitted
FINALISTS = 4  # of them, those that are refitted to convergence
FURTHER = 2  # the same, if effects that were found already leave little to explain
LEADERS = 1  # finalists that are refitted first
CLOSE_BEHIND = 0.1  # difference of the cost to the best within which further refits continue
STAGES = {"begun": "beginning refits", "refitted": "refitting effects", "continued": "continuing refits",
          "again": "refitting special cases"}  # fmt: skip


def fit_candidates(
    search: Search, screened: Sequence[Screened], model: RobotModel, problem: Problem, fit: Fit, held: HeldOut, few: bool = False
) -> list[Candidate]:  # fmt: skip
    """Refit the best effects of the screening and those that they may be confused with.

    few: whether only the best two are refitted to convergence.
    """
    trials = [single_trial(model, item, problem.hold, search.both_rules) for item in _shortlist(screened)]
    finalists, close = (FURTHER, 0.0) if few else (FINALISTS, CLOSE_BEHIND)
    candidates = refit_all(search, trials, fit.cost, finalists, close)
    if candidates and not few:
        candidates = finish_similar(search, trials, candidates)
    if not search.ranking:
        linear = {s.kind.name: s.score for s in screened}
        search.ranking = [
            Ranked(c.kind.name, float(np.mean(c.held_out.chi2)), *gain(held, c.held_out), linear[c.kind.name])
            for c in sorted(candidates, key=lambda c: c.held_out.score)
        ]
    return candidates


def refit_all(
    search: Search, trials: Sequence[Trial], rival: float, finalists: int, close: float = CLOSE_BEHIND
) -> list[Candidate]:  # fmt: skip
    """Run refits; after a few iterations, only the best and those close behind continue to convergence.

    rival: cost of another fit, far above which a refit is given up; close: difference of the cost within which more
    continue.
    """
    begun = _through_cache(search, trials, "begun", begin_refit, lambda t: (t, search.train, search.test, EARLY))
    ranked = sorted(range(len(trials)), key=lambda k: begun[k].fit.cost)
    near = min((c.fit.cost for c in begun), default=np.inf) + close
    final = [k for place, k in enumerate(ranked) if place < finalists or begun[k].fit.cost < near]
    done = dict(enumerate(begun))
    for part in (final[:LEADERS], final[LEADERS:]):  # refits of the second part stop when far behind the first
        index = {id(trials[k]): k for k in part}
        finished = _through_cache(
            search, [trials[k] for k in part], "refitted", finish_refit,
            lambda t, index=index, rival=rival: (t, begun[index[id(t)]], search.test, ITERATIONS - EARLY, rival),
        )  # fmt: skip
        done.update(zip(part, finished, strict=True))
        rival = min([rival, *(c.fit.cost for c in finished)])
    search.rollouts += sum(c.rollouts for c in done.values())
    return [done[k] for k in range(len(trials))]


def finish_similar(search: Search, trials: Sequence[Trial], candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, with further fits of effects that resemble the best one.

    A refit that is given up because it falls slowly may still end lower than the best. An effect is not preferred to
    a similar one with as few parameters before both fits have ended. A special case that ended far behind is fitted
    again from the best one's gains, because it may be in a wrong local minimum.
    """
    best = min(candidates, key=lambda c: c.fit.cost)
    begun = {id(t): c for t, c in zip(trials, candidates, strict=True)
             if c is not best and not c.fit.converged and _similar(c, best)}  # fmt: skip
    finished = _through_cache(
        search, [t for t in trials if id(t) in begun], "continued", finish_refit,
        lambda t: (t, begun[id(t)], search.test, ITERATIONS),
    )  # fmt: skip
    done = dict(zip(begun, finished, strict=True))
    search.rollouts += sum(done[key].rollouts - c.rollouts for key, c in begun.items())
    found = [done.get(id(t), c) for t, c in zip(trials, candidates, strict=True)]
    behind = {k: at_gains_of(trials[k], best) for k, c in enumerate(found)
              if c.kind.name in best.kind.generalises and c.fit.cost > best.fit.cost + CLOSE_BEHIND}  # fmt: skip
    again = _through_cache(search, list(behind.values()), "again", refit, lambda t: (t, search.train, search.test))
    search.rollouts += sum(c.rollouts for c in again)
    for k, other in zip(behind, again, strict=True):
        found[k] = min(found[k], other, key=lambda c: c.fit.cost)
    return found


def _similar(candidate: Candidate, best: Candidate) -> bool:
    """Whether an effect may be confused with the best one, and has no more parameters."""
    one, other = candidate.kind, best.kind
    confused = one.name in (*other.confused_with, *other.generalises) or other.name in one.confused_with
    return confused and len(candidate.problem.rows) <= len(best.problem.rows)


def beside_robot_errors(search: Search, candidate: Candidate) -> Candidate:
    """A candidate with its errors from a fit with nuisance parameters of the robot, to compare it with others.

    Otherwise a wrong effect with more parameters may absorb what a wrong mass or friction leaves with the right
    effects.
    """
    problem, fit = fit_with_robot_errors(candidate.problem, candidate.fit.x, search.train, derivatives=False)
    held_out = evaluate(problem.model_at(fit.x), search.test, problem.hold)
    search.rollouts += problem.rollouts
    return replace(candidate, fit=replace(candidate.fit, residuals=fit.residuals), held_out=held_out)


def close_to_best(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidate with the least cost, its special cases, and candidates with nearly the same cost."""
    best = min(candidates, key=lambda c: c.fit.cost)
    return [c for c in candidates if c.fit.cost < best.fit.cost + CLOSE_BEHIND or c.kind.name in best.kind.generalises]


def close_beside_robot_errors(search: Search, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates; if several are close to the best, those with their errors of a fit with nuisance parameters."""
    close = close_to_best(candidates)
    if len(close) < 2:
        return list(candidates)
    return [beside_robot_errors(search, c) if c in close else c for c in candidates]


def _through_cache(
    search: Search, trials: Sequence[Trial], stage: str, fit: Callable[..., Candidate],
    arguments: Callable[[Trial], tuple[Any, ...]],
) -> list[Candidate]:  # fmt: skip
    """Run one stage of refits, except for those that the cache contains."""
    cached = [search.cache.get(_key(t, stage)) for t in trials]
    fresh = [t for t, c in zip(trials, cached, strict=True) if c is None]

    def finished(done: int, c: Candidate) -> None:
        search.progress(
            STAGES[stage], done, len(fresh), effect=c.kind.name, held_out_error=search.milli(c.held_out.error)
        )
        search.cache.keep(_key(fresh[done - 1], stage), c.fit.x, c.problem.hold)

    made = iter(many(fit, [arguments(t) for t in fresh], search.jobs, finished))
    return [next(made) if c is None else resume_refit(t, c, search.train, search.test)
            for t, c in zip(trials, cached, strict=True)]  # fmt: skip


def _key(trial: Trial, stage: str) -> str:
    """Name of a refit in the cache."""
    turn = f", turn {trial.turn}" if trial.turn else ""
    return f"{trial.name}{', masses estimated' * trial.model.has_effect(InertialError)}{turn}, {stage}"


def _shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """The best effects of the screening, their special cases, and effects that the first two may be confused with."""
    promising = [s for s in screened if s.score > 0.01]
    names = {name for s in promising[:REFITS] for name in (s.kind.name, *s.kind.generalises)}
    for s in promising[:2]:
        names |= set(s.kind.confused_with)
    return [s for s in promising if s.kind.name in names]
