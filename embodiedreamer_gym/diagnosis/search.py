"""The search of a diagnosis: add one, two or more effects that lower the error, then eliminate backward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import (
    drop_last,
    drop_redundant,
    exchanged,
    prune_all,
    removed_joints,
    resolve_tie,
    with_joint,
)
from embodiedreamer_gym.diagnosis.candidates import Candidate, polish
from embodiedreamer_gym.diagnosis.exactness import fit_together
from embodiedreamer_gym.diagnosis.other_valleys import leave_valleys
from embodiedreamer_gym.diagnosis.pair_search import add_pair
from embodiedreamer_gym.diagnosis.refits import close_beside_robot_errors, fit_candidates
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.diagnosis.search_state import (
    SURE,
    Search,
    SearchState,
    added_effects,
    current_null,
    likeliest,
    screen_all,
)
from embodiedreamer_gym.diagnosis.special_cases import prefer_special_cases
from embodiedreamer_gym.diagnosis.unseen_motion import contradicted
from embodiedreamer_gym.diagnosis.verdict import (
    FAR,
    INEXACT,
    SMALLEST_GAIN,
    brings_little,
    contenders,
    explains_most,
    improves,
    is_far_from_noise,
    leaves_excess,
    unrefuted,
)

PARTNERED = 1  # best single effects for which a partner is searched


def search_effects(
    search: Search, state: SearchState, screened: Sequence[Screened], max_effects: int
) -> SearchState:  # fmt: skip
    """Find the missing effects: one if it is enough, else a pair, else one more; then eliminate backward."""
    if state.by_effort:
        add_effects(search, state, screened, max_effects)
        eliminate(search, state)
        return state
    singles = fit_candidates(search, screened, *state.start, state.base)
    if not singles:
        return state
    state.closest = min(singles, key=lambda c: c.held_out.score)
    improving = state.improving(singles)
    if improving:
        improving = leave_valleys(search, state, improving)
        judged = close_beside_robot_errors(search, improving)
        best = improving[judged.index(likeliest(search, state, judged))]
        state.steps = [polish(best, search.test)]
        search.rollouts += state.steps[0].rollouts - best.rollouts
        state.null = current_null(search, state)
        fit_together(search, state)
    if max_effects > 1 and not state.is_exact:
        add_pair(search, state, screened, sorted(singles, key=lambda c: c.fit.cost)[:PARTNERED])
        if len(state.steps) == 2 and state.is_exact:
            keep_one_if_enough(search, state, improving)
        elif len(state.steps) == 2:
            add_effects(search, state, screened, max_effects)
    if state.is_exact or is_far_from_noise(state.base, state.held, state.start_null.chi2):
        prefer_special_cases(search, state)
    eliminate(search, state)
    state.unseen = contradicted(search, state, singles)
    return state


def keep_one_if_enough(search: Search, state: SearchState, singles: Sequence[Candidate]) -> None:
    """Keep only one effect of a pair if it alone is exact, or nearly exact and the other effect brings little.

    The screening may not have selected it as a single effect, or its fit may have ended in a wrong local minimum. A law
    that is not quite exact leaves more error the larger the effect is, and nearly any second effect absorbs some of it.

    singles: single effects that improve on the start, for comparison.
    """
    before = (state.steps, state.null, state.together, state.tie, state.probabilities)
    pair = state.steps[-1]
    names = added_effects(state.start[0], pair.model)
    for name, kept in zip(names, reversed(names), strict=True):
        removed = replace(pair, kind=search.catalogue[name])
        alone = replace(exchanged(pair, removed, None, search.train, search.test), kind=search.catalogue[kept])
        search.rollouts += alone.rollouts
        state.steps = [alone]
        state.null = current_null(search, state)
        fit_together(search, state)
        enough = state.is_exact or (
            state.excess <= INEXACT and brings_little(state.judged_start, alone.judged, pair.judged)
        )
        if enough and likeliest(search, state, [alone, *(c for c in singles if c.kind.name != kept)]) is alone:
            return
    state.steps, state.null, state.together, state.tie, state.probabilities = before


def add_effects(
    search: Search, state: SearchState, screened: Sequence[Screened], max_effects: int
) -> None:  # fmt: skip
    """Add effects one at a time, refitting all parameters each time, until the model is as good as faultless robots."""
    while len(state.steps) < max_effects and state.is_wrong:
        held, null, further = state.held, state.null, bool(state.steps)
        if further:
            screened = screen_all(search, *state.current[1:], null, first=False)
        candidates = fit_candidates(search, screened, *state.current, held, further and not state.by_effort)
        improving = [
            c for c in candidates if _accepted(state, c) and (not further or explains_most(held, c.held_out, null.chi2))
        ]
        if candidates and state.closest is None:
            state.closest = min(candidates, key=lambda c: c.held_out.score)
        if not improving:
            return
        close = contenders(held, unrefuted(improving, null.chi2) if state.by_effort else improving)
        if not further and len(close) > 1:
            state.set_rivals(close)
        chosen = polish(close[0], search.test)
        search.rollouts += chosen.rollouts - close[0].rollouts
        if not _accepted(state, chosen):
            return
        state.steps.append(chosen)
        state.null = current_null(search, state)
        search.progress(
            f"added {chosen.kind.name}",
            len(state.steps),
            max_effects,
            held_out_error=search.milli(chosen.held_out.error),
        )


def _accepted(state: SearchState, candidate: Candidate) -> bool:
    """Whether an effect lowers the held-out error, or for efforts lowers the error on all motion down to the noise.

    On slow held-out motion, a model with too little inertia can have an error below the noise of the right model.
    """
    if improves(state.held, candidate.held_out):
        return True
    exact = state.by_effort and not leaves_excess(candidate.held_out, state.null.chi2)
    return exact and improves(state.judged, candidate.judged, state.most)


def _rise(state: SearchState, everywhere: Candidate) -> np.ndarray:
    """Increase of the held-out log chi2 (n,) relative to a model whose effects act on more joints."""
    return np.log(np.maximum(state.held.chi2, 1.0) / np.maximum(everywhere.held_out.chi2, 1.0))


def _restore_joints(search: Search, state: SearchState, everywhere: list[Candidate], exact: bool) -> None:
    """Restore effects joint by joint where the error rises without them; the joint with the largest rise is first.

    If a wrong law leaves most of a joint's error, or a law jumps, no estimate there is significant.

    everywhere: the steps before effects were removed from joints; exact: whether these were exact.
    """
    joints, whole = list(state.start[0].joints), everywhere[-1]
    while not state.is_exact and (exact or _rise(state, whole).max() > SMALLEST_GAIN):
        missing = removed_joints(whole, state.steps[-1])
        if len(missing) < 2:  # all are restored
            state.steps = everywhere
            fit_together(search, state)
            return
        rise = dict(zip(joints, _rise(state, whole), strict=True))
        worst = max(sorted(missing), key=lambda joint: rise.get(joint, -np.inf))
        state.steps = [*state.steps[:-1], with_joint(state.steps[-1], whole, worst, search.train, search.test)]
        fit_together(search, state)


def eliminate(search: Search, state: SearchState) -> None:
    """Drop redundant effects, resolve a tie for the first, and take each effect off the joints that do not need it.

    The last effect is dropped too if it does not lower the held-out error significantly. Effects that leave too much
    error to be named are not taken off any joint, unless the errors are far above the noise anyway.
    """
    far = is_far_from_noise(state.base, state.held, state.start_null.chi2)
    if not state.steps or (not state.by_effort and not state.is_exact and state.excess > FAR and not far):
        return
    search.progress("backward elimination", 0, len(state.steps), held_out_error=search.milli(state.held.error))
    spent, first = sum(s.rollouts for s in state.steps), state.steps[0]
    if len(state.steps) > 1:
        state.steps = drop_redundant(state.steps, search.train, search.test)
        if state.steps[0] is not first:
            state.set_rivals([])
    if state.rivals and len(state.steps) > 1:
        state.steps, close = resolve_tie(state.base, state.rivals, state.steps, search.train, search.test)
        state.set_rivals(close)
    exact, everywhere = state.is_exact, list(state.steps)
    state.steps = prune_all(state.steps, search.train, search.test)
    state.steps[-1] = polish(state.steps[-1], search.test)
    fit_together(search, state)
    _restore_joints(search, state, everywhere, exact)
    if len(state.steps) > 1 or not state.is_exact:
        state.steps = drop_last(state.judged_start, state.steps, search.train, search.test, state.most)
    left = added_effects(state.start[0], state.current[0])
    if all(state.probabilities.get(name, 0.0) >= SURE for name in left):  # also if none is left
        state.tie = ()
    search.rollouts += sum(s.rollouts for s in state.steps) - spent
    state.null = current_null(search, state)
    fit_together(search, state)
