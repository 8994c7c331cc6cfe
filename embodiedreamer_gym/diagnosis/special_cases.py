"""Special cases: check whether the special case of an added law does as well in its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import refit, single_trial
from embodiedreamer_gym.diagnosis.exactness import fit_together
from embodiedreamer_gym.diagnosis.refits import beside_robot_errors
from embodiedreamer_gym.diagnosis.screening import linearise, screen_effect
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState, current_null, likeliest
from embodiedreamer_gym.phys_aligner.least_squares import fit_at
from embodiedreamer_gym.phys_aligner.problem import Problem


def prefer_special_cases(search: Search, state: SearchState) -> None:
    """Replace an effect of the last step by its special case if that is not much less probable.

    For a single effect, both are among the candidates. In a pair, the special case may not have been fitted, or its fit
    may have ended in a wrong local minimum.
    """
    if len(state.steps) < 2:
        return
    for effect in state.steps[-1].model.effects:
        for name in type(effect).generalises:
            last = state.steps[-1]
            known = state.start[0].has_effect(type(effect))
            if known or name not in search.catalogue or last.model.has_effect(search.catalogue[name]):
                continue
            kind = search.catalogue[name]
            without = last.model.without_effect(effect.name)
            problem = Problem(without, search.train, hold=last.problem.hold)
            short, points = linearise(problem, fit_at(problem, problem.start), None)
            screened = screen_effect(kind, points, short, np.ones(without.n))
            trial = single_trial(without, replace(screened, joints=None), problem.hold, False)
            plain = refit(trial, search.train, search.test)
            search.rollouts += problem.rollouts + plain.rollouts
            judged = [beside_robot_errors(search, c) for c in (last, plain)]
            if likeliest(search, state, judged) is judged[1]:
                rename = {effect.name: kind}
                steps = [replace(s, kind=rename.get(s.kind.name, s.kind)) for s in state.steps[:-1]]
                state.steps = [*steps, replace(plain, kind=rename.get(last.kind.name, last.kind))]
                state.null = current_null(search, state)
                fit_together(search, state)
                break
