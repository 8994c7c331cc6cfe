"""A second effect: partners of the best single ones, and the best pairs of the linearised model, refitted and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import exchanged
from embodiedreamer_gym.diagnosis.candidates import Candidate, Trial, polish
from embodiedreamer_gym.diagnosis.effect_starts import Values, pair_starts
from embodiedreamer_gym.diagnosis.pair_screening import is_contained, screen_pairs
from embodiedreamer_gym.diagnosis.refits import refit_all
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.search_state import (
    Search,
    SearchState,
    added_effects,
    current_null,
    fit_together,
    likeliest,
    screen_all,
)
from embodiedreamer_gym.diagnosis.verdict import explains_most, improves
from embodiedreamer_gym.effects import Effect

FINALISTS = 3  # pairs that are refitted to the end
PARTNERS = 3  # of a single effect, and pairs of the linearised model, that are refitted


def add_pair(
    search: Search, state: SearchState, screened: Sequence[Screened], singles: Sequence[Candidate]
) -> None:  # fmt: skip
    """Replace the steps by two where a pair leaves nothing, or explains most of what one effect leaves.

    screened: effects around the start; singles: the best single effects, by their training cost.
    """
    base, nominal = state.start[0], next((s.nominal for s in screened), {})
    around = [trial for single in singles for trial in _partners(search, state, single, nominal)]
    trials = {
        frozenset(added_effects(base, t.model)): t for t in [*_linear_pairs(search, state, screened, nominal), *around]
    }
    pairs = refit_all(search, list(trials.values()), np.inf, FINALISTS)
    pairs = [pair for pair in pairs if improves(state.judged, pair.judged, state.most)]
    if not pairs:
        return
    tie, probabilities = state.tie, state.probabilities
    best = likeliest(search, state, pairs)
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


def _partners(search: Search, state: SearchState, single: Candidate, nominal: Values) -> list[Trial]:
    """A second effect beside a single one, the best of a screening around it."""
    screened = screen_all(search, single.problem, single.fit, state.null, first=False)
    chosen = [s for s in screened if s.score > 0.01 and not is_contained(s.kind, single.kind)][:PARTNERS]
    groups = {row.key.group for row in single.problem.rows}
    fitted = {group: single.model.group_values(group) for group in groups}
    trials = []
    for item in chosen:
        kinds, start = (single.kind, item.kind), {**fitted, **{k: v for k, v in item.start.items() if k.effect}}
        trials.append(_trial(state, kinds, start, nominal, fitted))
    return trials


def _linear_pairs(
    search: Search, state: SearchState, screened: Sequence[Screened], nominal: Values
) -> list[Trial]:  # fmt: skip
    """The best pairs of the linearised model."""
    if search.linearised is None:
        return []
    problem, point = search.linearised
    floor = np.sqrt(np.median(state.null.chi2, axis=0))
    return [_trial(state, p.kinds, p.start, nominal) for p in screen_pairs(screened, point, problem, floor, PARTNERS)]


def _trial(
    state: SearchState, kinds: tuple[type[Effect], type[Effect]], start: Values, nominal: Values, fitted: Values | None = None
) -> Trial:  # fmt: skip
    base, problem, _ = state.start
    model = base.with_effect(kinds[0]).with_effect(kinds[1])
    return Trial(kinds[1], model, pair_starts(kinds, model, start, nominal, fitted), (problem.hold,))


def _as_steps(search: Search, state: SearchState, pair: Candidate, singles: Sequence[Candidate]) -> list[Candidate]:
    """The single effect of a pair that fits better, and the pair."""
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
