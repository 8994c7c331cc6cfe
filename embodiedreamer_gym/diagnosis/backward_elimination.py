"""Backward elimination: drop effects that later ones made redundant, resolve a tie, remove effects from idle joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, TOLERANCE, Candidate, as_candidate, polish
from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.diagnosis.joint_selection import select_joints
from embodiedreamer_gym.diagnosis.limits import release_limits
from embodiedreamer_gym.diagnosis.verdict import TIE, contenders, improves
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording


def drop_redundant(
    steps: Sequence[Candidate], train: Sequence[Recording], test: Sequence[Recording]
) -> list[Candidate]:  # fmt: skip
    """Remove each step except the last if the others, refitted, score as well without it."""
    steps = list(steps)
    for early in steps[:-1]:
        last = steps[-1]
        less = exchanged(last, early, None, train, test)
        if less.judged.score <= last.judged.score + TIE:
            kept = [s for s in steps[:-1] if s is not early]
            steps = [*kept, replace(less, kind=last.kind, rollouts=last.rollouts + less.rollouts)]
    return steps


def drop_last(
    before: HeldOut, steps: Sequence[Candidate], train: Sequence[Recording], test: Sequence[Recording],
    most: np.ndarray | None = None,
) -> list[Candidate]:  # fmt: skip
    """Remove the last step as long as the others, refitted, are not significantly worse or have no larger error.

    before: error of the model without any effect, on the motion on which the steps are judged.
    most: see `improves`.
    """
    steps = list(steps)
    while steps:
        last, others = steps[-1], steps[:-1]
        options: list[Candidate] = []
        if others:
            options = [replace(exchanged(last, last, None, train, test), kind=others[-1].kind)]
            if _names(others[-1]) == _names(options[0]):
                options.append(others[-1])  # the fit from which the last step started
        without = [option.judged for option in options] or [before]
        if all(improves(held, last.judged, most) and last.judged.error < held.error for held in without):
            break
        spent = last.rollouts + sum(option.rollouts for option in options[:1])
        if options:
            best = polish(min(options, key=lambda option: option.held_out.score), test)
            others[-1] = replace(best, rollouts=best.rollouts + spent)
        steps = others
    return steps


def _names(candidate: Candidate) -> set[str]:
    """Names of the effects of a candidate's model."""
    return {effect.name for effect in candidate.model.effects}


def resolve_tie(
    before: HeldOut, rivals: Sequence[Candidate], steps: Sequence[Candidate], train: Sequence[Recording],
    test: Sequence[Recording],
) -> tuple[list[Candidate], list[Candidate]]:  # fmt: skip
    """Choose the first effect among tied candidates after others were added: the steps, and candidates that still tie.

    before: held-out error without any effect. Each rival replaces the first effect and all parameters are fitted again.
    """
    first, last = steps[0], steps[-1]
    options = [replace(last, kind=first.kind)]
    named = {step.kind.name for step in steps}
    options += [exchanged(last, first, r, train, test) for r in rivals if r.kind.name not in named]
    close = contenders(before, options)
    best = close[0]
    spent = sum(o.rollouts for o in options[1:])
    if best is options[0]:
        return list(steps), close
    renamed = next(r for r in rivals if r.kind is best.kind)
    return [renamed, *steps[1:-1], replace(best, kind=last.kind, rollouts=last.rollouts + spent)], close


def prune_all(
    steps: Sequence[Candidate], train: Sequence[Recording], test: Sequence[Recording]
) -> list[Candidate]:  # fmt: skip
    """The steps, with each effect restricted to the joints that need it, given all effects."""
    last = steps[-1]
    for kind in dict.fromkeys(step.kind for step in steps):
        last = select_joints(replace(last, kind=kind), train, test)
    return [*steps[:-1], replace(last, kind=steps[-1].kind)]


def removed_joints(whole: Candidate, pruned: Candidate) -> set[str]:
    """Joints on which some effect acts in `whole` but not in `pruned`."""
    left = {(e.name, j) for e in pruned.model.effects for own in e.values.values() for j in own}
    return {j for e in whole.model.effects for own in e.values.values() for j in own if (e.name, j) not in left}


def with_joint(
    pruned: Candidate, whole: Candidate, joint: str, train: Sequence[Recording], test: Sequence[Recording]
) -> Candidate:  # fmt: skip
    """The pruned candidate with its effects on one joint restored from `whole`, fitted again."""
    before = {e.name: e for e in whole.model.effects}
    effects = []
    for effect in pruned.model.effects:
        values = {
            name: {
                j: own.get(j, value) for j, value in before[effect.name].values[name].items() if j in own or j == joint
            }
            for name, own in effect.values.items()
        }
        effects.append(type(effect)(**values))
    problem = Problem(pruned.model.with_(effects=tuple(effects)), train, hold=pruned.problem.hold)
    fit = release_limits(problem, minimise(problem, problem.start, ITERATIONS, TOLERANCE))
    found = as_candidate(pruned.kind, problem, fit, test)
    return replace(found, rollouts=pruned.rollouts + found.rollouts)


def exchanged(
    last: Candidate, old: Candidate, new: Candidate | None, train: Sequence[Recording], test: Sequence[Recording]
) -> Candidate:  # fmt: skip
    """The last step's model with one effect replaced by another or removed, fitted again."""
    effects: list[Effect] = []
    for effect in last.model.effects:
        if effect.name != old.kind.name:
            effects.append(effect)
        elif new is not None:
            effects.append(next(e for e in new.model.effects if e.name == new.kind.name))
    problem = Problem(last.model.with_(effects=tuple(effects)), train, hold=last.problem.hold)
    fit = minimise(problem, problem.start, ITERATIONS, TOLERANCE)
    return as_candidate(last.kind if new is None else new.kind, problem, fit, test)
