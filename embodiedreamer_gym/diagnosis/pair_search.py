"""Search for a second effect: refit and compare partners of single effects and pairs of the linear model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import exchanged
from embodiedreamer_gym.diagnosis.candidates import Candidate, Trial, polish
from embodiedreamer_gym.diagnosis.effect_starts import Values, fitted_values, pair_starts
from embodiedreamer_gym.diagnosis.exactness import fit_together
from embodiedreamer_gym.diagnosis.other_valleys import leave_valleys
from embodiedreamer_gym.diagnosis.pair_screening import is_contained, screen_pairs
from embodiedreamer_gym.diagnosis.refits import beside_robot_errors, refit_all
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.search_state import (
    Search,
    SearchState,
    added_effects,
    current_null,
    likeliest,
    screen_all,
)
from embodiedreamer_gym.diagnosis.verdict import explains_most
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.calibration import STUCK
from embodiedreamer_gym.phys_aligner.least_squares import fit_at
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import RobotModel

FINALISTS = 3  # pairs that are refitted to convergence
LINEAR = 3  # pairs of the linearised model that are refitted
PARTNERS = 7  # partners of an effect that are refitted
RIVALS = 3  # pairs with the least cost that are compared with nuisance parameters
WORTH = 0.01  # fall of the cost above which another round is made
EXCHANGES = 3  # rounds in which each effect of the best pair is exchanged


def add_pair(
    search: Search, state: SearchState, screened: Sequence[Screened], singles: Sequence[Candidate]
) -> None:  # fmt: skip
    """Replace the steps by a pair if it leaves nothing to explain or explains most of what one effect leaves.

    screened: effects screened around the start; singles: the best single effects, by their training cost.
    """
    base, nominal = state.start[0], next((s.nominal for s in screened), {})
    around: list[Trial] = []
    for c in singles:
        near = screen_all(search, c.problem, c.fit, state.null, first=False)
        around += _partners(state, c.kind, c.model, near, nominal)
    trials = {
        frozenset(added_effects(base, t.model)): t for t in [*_linear_pairs(search, state, screened, nominal), *around]
    }
    pairs = refit_all(search, list(trials.values()), np.inf, FINALISTS)
    least = min((c.fit.cost for c in singles), default=np.inf)
    if min((c.fit.cost for c in pairs), default=np.inf) < least - WORTH:
        pairs = _exchange(search, state, pairs, nominal)
    pairs = state.improving(pairs)
    if not pairs:
        return
    tie, probabilities = state.tie, state.probabilities
    rivals = leave_valleys(search, state, sorted(pairs, key=lambda c: c.fit.cost)[:RIVALS])
    judged = [beside_robot_errors(search, c) for c in rivals]
    best = rivals[judged.index(likeliest(search, state, judged))]
    chosen = polish(best, search.test)
    search.rollouts += chosen.rollouts - best.rollouts
    before = (state.steps, state.null, state.judged, state.together)
    state.steps = _as_steps(search, state, chosen, [*state.steps, *singles])
    state.null = current_null(search, state)
    fit_together(search, state)
    if state.is_exact or explains_most(before[2], chosen.judged, before[1].chi2):
        return
    state.steps, state.null, _, state.together = before
    state.tie, state.probabilities = tie, probabilities


def _exchange(search: Search, state: SearchState, pairs: list[Candidate], nominal: Values) -> list[Candidate]:
    """The pairs, and further pairs with one effect of the best pair replaced, until this no longer improves the fit.

    Gains and an effect that were fitted together with another effect, even a wrong one, are nearer the truth than those
    of a fit without one. Screening around them finds the missing effect, and sizes that a fit from farther away did not
    reach. If a pair leaves no joint above its noise, its effects are replaced by similar ones only. The effect that the
    last turn found is kept, because it is the best partner of the other one; only the other one is replaced.
    """
    best = min(pairs, key=lambda c: c.fit.cost, default=None)
    for turn in range(1, EXCHANGES + 1):
        if best is None:
            break
        trials: list[Trial] = []
        for name in added_effects(state.start[0], best.model):
            if turn > 1 and name == best.kind.name:
                continue
            rest = best.model.without_effect(name)
            kept = next(search.catalogue[n] for n in added_effects(state.start[0], rest))
            problem = Problem(rest, search.train, hold=best.problem.hold)
            fit = fit_at(problem, problem.start)
            others = search.catalogue if best.trained.chi2.max() > STUCK else _similar(search, name)
            screened = screen_all(search, problem, fit, state.null, False, others, at_nominal=False)
            trials += [replace(t, turn=turn) for t in _partners(state, kept, problem.model, screened, nominal)]
        last, pairs = best, [*pairs, *refit_all(search, trials, best.fit.cost, FINALISTS)]
        best = min(pairs, key=lambda c: c.fit.cost)
        if best.fit.cost > last.fit.cost - WORTH:
            break
    ranked = sorted(pairs, key=lambda c: -c.fit.cost)
    return list({frozenset(added_effects(state.start[0], c.model)): c for c in ranked}.values())


def _similar(search: Search, name: str) -> dict[str, type[Effect]]:
    """Effects that a given one may be confused with, its special cases, and effects of which it is a special case."""
    kind = search.catalogue[name]
    return {n: k for n, k in search.catalogue.items() if n in kind.confused_with or is_contained(kind, k)}


def _partners(
    state: SearchState, kind: type[Effect], model: RobotModel, screened: Sequence[Screened], nominal: Values
) -> list[Trial]:  # fmt: skip
    """Trials of a second effect for a model that has one: the best effects of a screening around it."""
    chosen = [s for s in screened if s.score > 0.01 and not is_contained(s.kind, kind)][:PARTNERS]
    fitted = fitted_values(model)
    trials = []
    for item in chosen:
        start = {**fitted, **{k: v for k, v in item.start.items() if k.effect}}
        trials.append(_trial(state, (kind, item.kind), start, nominal, fitted))
    return trials


def _linear_pairs(
    search: Search, state: SearchState, screened: Sequence[Screened], nominal: Values
) -> list[Trial]:  # fmt: skip
    """Trials of the best pairs of the linearised model."""
    if search.linearised is None:
        return []
    problem, point = search.linearised
    floor = np.sqrt(np.median(state.null.chi2, axis=0))
    return [_trial(state, p.kinds, p.start, nominal) for p in screen_pairs(screened, point, problem, floor, LINEAR)]


def _trial(
    state: SearchState, kinds: tuple[type[Effect], type[Effect]], start: Values, nominal: Values, fitted: Values | None = None
) -> Trial:  # fmt: skip
    base, problem, _ = state.start
    model = base.with_effect(kinds[0]).with_effect(kinds[1])
    return Trial(kinds[1], model, pair_starts(kinds, model, start, nominal, fitted), (problem.hold,))


def _as_steps(search: Search, state: SearchState, pair: Candidate, singles: Sequence[Candidate]) -> list[Candidate]:
    """A pair as two steps: the one of its effects that fits better alone, then both."""
    names = added_effects(state.start[0], pair.model)
    own = [c for c in singles if c.kind.name in names]
    if own:
        first = min(own, key=lambda c: c.fit.cost)
    else:
        first = exchanged(pair, pair, None, search.train, search.test)
        left = next(name for name in names if name != pair.kind.name)
        first = replace(first, kind=search.catalogue[left])
    second = next(search.catalogue[name] for name in names if name != first.kind.name)
    return [first, replace(pair, kind=second)]
