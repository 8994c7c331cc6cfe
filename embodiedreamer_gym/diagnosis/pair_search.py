"""A second effect: partners of the best single ones, and the best pairs of the linearised model, refitted and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import exchanged
from embodiedreamer_gym.diagnosis.candidates import Candidate, polish
from embodiedreamer_gym.diagnosis.pair_screening import refit_pair, screen_pairs
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.search_state import (
    Search,
    SearchState,
    added_effects,
    current_null,
    likeliest,
    refit_all,
    screen_all,
)
from embodiedreamer_gym.diagnosis.verdict import explains_most, improves
from embodiedreamer_gym.io.parallel import many

PARTNERS = 3  # of a single effect, and pairs of the linearised model, that are refitted


def add_pair(
    search: Search, state: SearchState, screened: Sequence[Screened], singles: Sequence[Candidate]
) -> None:  # fmt: skip
    """Replace the steps by two where a pair leaves nothing, or explains most of what one effect leaves.

    screened: effects around the start; singles: the best single effects, by their training cost.
    """
    pairs = [pair for single in singles for pair in _partners(search, state, single)]
    pairs += _linear_pairs(search, state, screened, pairs)
    pairs = [pair for pair in pairs if improves(state.judged, pair.judged)]
    if not pairs:
        return
    tie, probabilities = state.tie, state.probabilities
    best = likeliest(search, state, pairs)
    chosen = polish(best, search.test)
    search.rollouts += chosen.rollouts - best.rollouts
    before = (state.steps, state.null, state.judged)
    state.steps = _as_steps(search, state, chosen, [*state.steps, *singles])
    state.null = current_null(search, state)
    if state.is_exact or explains_most(before[2], chosen.judged, before[1].chi2):
        return
    state.steps, state.null = before[:2]
    state.tie, state.probabilities = tie, probabilities


def _partners(search: Search, state: SearchState, single: Candidate) -> list[Candidate]:
    """Refits with a second effect beside a single one, the best of a screening around it."""
    screened = screen_all(search, single.problem, single.fit, state.null, first=False)
    kinds = {*single.kind.generalises, *(n for n, k in search.catalogue.items() if single.kind.name in k.generalises)}
    chosen = [s for s in screened if s.score > 0.01 and s.kind.name not in kinds][:PARTNERS]
    return refit_all(search, chosen, single.model, single.problem, np.inf)


def _linear_pairs(
    search: Search, state: SearchState, screened: Sequence[Screened], found: Sequence[Candidate]
) -> list[Candidate]:  # fmt: skip
    """Refits of the best pairs of the linearised model, but of those that are fitted already."""
    assert search.linearised is not None  # the first screening comes before any pair
    problem, point = search.linearised
    floor = np.sqrt(np.median(state.null.chi2, axis=0))
    known = {frozenset(added_effects(state.start[0], c)) for c in found}
    pairs = [p for p in screen_pairs(screened, point, problem, floor, PARTNERS + len(known))
             if frozenset(k.name for k in p.kinds) not in known][:PARTNERS]  # fmt: skip
    rival = min((c.fit.cost for c in found), default=np.inf)
    nominal = next((s.nominal for s in screened), {})
    calls = [(state.start[0], p, nominal, state.start[1].hold, search.train, search.test, rival) for p in pairs]
    fitted = many(refit_pair, calls, search.jobs)
    search.rollouts += sum(c.rollouts for c in fitted)
    return fitted


def _as_steps(search: Search, state: SearchState, pair: Candidate, singles: Sequence[Candidate]) -> list[Candidate]:
    """The single effect of a pair that fits better, and the pair."""
    names = added_effects(state.start[0], pair)
    own = [c for c in singles if c.kind.name in names]
    if own:
        first = min(own, key=lambda c: c.fit.cost)
    else:
        first = exchanged(pair, pair, None, search.train, search.test)
        left = next(name for name in names if name != pair.kind.name)
        first = replace(first, kind=search.catalogue[left])
    second = next(search.catalogue[name] for name in names if name != first.kind.name)
    return [first, replace(pair, kind=second)]
