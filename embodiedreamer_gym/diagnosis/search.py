"""The search of a diagnosis: screen, refit, add the effect that lowers the held-out error, again; then eliminate backward."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import drop_last, drop_redundant, prune_all, resolve_tie
from embodiedreamer_gym.diagnosis.candidates import Candidate, polish, refit
from embodiedreamer_gym.diagnosis.held_out import HeldOut, gain
from embodiedreamer_gym.diagnosis.null_distribution import NullDistribution, draw_null
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.screening import VISIBLE_SHARE, Screened, linearise, screen
from embodiedreamer_gym.diagnosis.verdict import (
    ALARM,
    contenders,
    explains_most,
    improves,
    is_convincing,
    leaves_excess,
)
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.io.parallel import many
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

REFITS = 5  # best of the screening that are refitted
LEADERS = 2  # of them that are refitted to the end


@dataclass(frozen=True)
class Ranked:
    """One effect that was refitted alone.

    held_out_chi2: mean over joints of the held-out chi2.
    gain, gain_error: fall of the held-out score, and its standard error.
    screening: fall of the log residual in the linear screening.
    note: why the effect is not named although it ranks before one that is, else "".
    """

    effect: str
    held_out_chi2: float
    gain: float
    gain_error: float
    screening: float
    note: str = ""


@dataclass
class Search:
    """Settings and counters of a running diagnosis.

    both_rules: whether refits try both rules between two commands; by_pieces: whether refits begin with fits to pieces
    of the motion.
    """

    nominal: RobotModel
    train: Sequence[Recording]
    test: Sequence[Recording]
    catalogue: Mapping[str, type[Effect]]
    jobs: int
    progress: ProgressCallback
    both_rules: bool
    rng: np.random.Generator
    cache: RefitCache
    unit: str = "rad"
    by_pieces: bool = False
    rollouts: int = 0
    ranking: list[Ranked] = field(default_factory=list)
    unobservable: tuple[str, ...] = ()

    def milli(self, error: float) -> str:
        """A held-out error as "1.23 mrad"."""
        return milli(error, self.unit)


@dataclass
class SearchState:
    """The calibrated start of a search and the effects added to it.

    base: held-out error of the start; null: of faultless robots like the model so far; steps: one candidate per added
    effect; tie: candidates for the first step that held-out motion does not distinguish; closest: best single effect.
    """

    start: tuple[RobotModel, Problem, Fit]
    base: HeldOut
    null: NullDistribution
    steps: list[Candidate] = field(default_factory=list)
    tie: list[Candidate] = field(default_factory=list)
    closest: Candidate | None = None

    @property
    def current(self) -> tuple[RobotModel, Problem, Fit]:
        """Model, problem and fit so far."""
        return (self.steps[-1].model, self.steps[-1].problem, self.steps[-1].fit) if self.steps else self.start

    @property
    def is_wrong(self) -> bool:
        """Whether the model so far is worse than faultless robots are."""
        alarm = self.null.p_value(self.held.chi2) < ALARM
        return alarm or (bool(self.steps) and leaves_excess(self.held, self.null.chi2))

    @property
    def is_exact(self) -> bool:
        """Whether no joint is worse than those of faultless robots usually are."""
        return bool(self.steps) and not leaves_excess(self.held, self.null.chi2)

    @property
    def held(self) -> HeldOut:
        """Held-out error of the model so far."""
        return self.steps[-1].held_out if self.steps else self.base


def search_effects(
    search: Search, state: SearchState, screened: Sequence[Screened], max_effects: int
) -> SearchState:  # fmt: skip
    """Add effects and eliminate backward; once more with fits by pieces where the result is not convincing."""
    again = replace(state, steps=[], tie=[])
    add_effects(search, state, screened, max_effects)
    eliminate(search, state)
    if is_convincing(state.base, state.held, state.null.chi2) or state.start[1].signals.by_effort:
        return state  # inverse runs have no pieces that are easier to fit
    first = search.ranking
    search.by_pieces, search.ranking = True, []
    add_effects(search, again, screened, max_effects)
    eliminate(search, again)
    if again.held.score < state.held.score:
        return again
    search.ranking = first
    return state


def add_effects(
    search: Search, state: SearchState, screened: Sequence[Screened], max_effects: int
) -> None:  # fmt: skip
    """Add effects one at a time, all parameters refitted each time, until the model does as well as faultless robots."""
    while len(state.steps) < max_effects and state.is_wrong:
        held, null, further = state.held, state.null, bool(state.steps)
        if further:
            screened = screen_all(search, *state.current[1:], null, first=False)
        candidates = _candidates(search, screened, *state.current, held)
        improving = [
            c
            for c in candidates
            if improves(held, c.held_out) and (not further or explains_most(held, c.held_out, null.chi2))
        ]
        if candidates and state.closest is None:
            state.closest = min(candidates, key=lambda c: c.held_out.score)
        if not improving:
            return
        close = contenders(held, improving)
        if not further and len(close) > 1:
            state.tie = close
        chosen = polish(close[0], search.test)
        search.rollouts += chosen.rollouts - close[0].rollouts
        if not improves(held, chosen.held_out):
            return
        state.steps.append(chosen)
        state.null = _null(search, state)
        search.progress(
            f"added {chosen.kind.name}",
            len(state.steps),
            max_effects,
            held_out_error=search.milli(chosen.held_out.error),
        )


def eliminate(search: Search, state: SearchState) -> None:
    """Drop redundant effects, resolve a tie for the first, and take each effect off the joints that do not need it.

    The last effect goes too where the held-out error does not fall by it, or not significantly.
    """
    if not state.steps:
        return
    search.progress("backward elimination", 0, len(state.steps), held_out_error=search.milli(state.held.error))
    spent, first = sum(s.rollouts for s in state.steps), state.steps[0]
    if len(state.steps) > 1:
        state.steps = drop_redundant(state.steps, search.train, search.test)
        if state.steps[0] is not first:
            state.tie = []
    if state.tie and len(state.steps) > 1:
        state.steps, close = resolve_tie(state.base, state.tie, state.steps, search.train, search.test)
        state.tie = close if len(close) > 1 else []
    state.steps = prune_all(state.steps, search.train, search.test)
    state.steps[-1] = polish(state.steps[-1], search.test)
    state.steps = drop_last(state.base, state.steps, search.train, search.test)
    if not state.steps:
        state.tie = []
    search.rollouts += sum(s.rollouts for s in state.steps) - spent
    state.null = _null(search, state)


def screen_all(search: Search, problem: Problem, fit: Fit, null: NullDistribution, first: bool) -> list[Screened]:
    """Screen the catalogue; the first time also note what these sensors and this motion cannot show."""
    floor = np.sqrt(np.median(null.chi2, axis=0))
    before = problem.rollouts
    short, points = linearise(problem, fit, search.nominal)
    screened = screen(search.catalogue, points, short, floor, search.jobs, search.progress)
    search.rollouts += short.rollouts - before + sum(s.rollouts for s in screened)
    if first:
        search.unobservable = tuple(s.kind.name for s in screened if s.visible < VISIBLE_SHARE)
    return screened


def _candidates(
    search: Search, screened: Sequence[Screened], model: RobotModel, problem: Problem, fit: Fit, held: HeldOut
) -> list[Candidate]:  # fmt: skip
    """Refit the best of the screening and the effects that they may be confused with."""
    notes = ", by pieces" * search.by_pieces + ", masses estimated" * model.has_effect(InertialError)
    chosen, step = _shortlist(screened), f"{len(model.effects)} effects{notes}"
    candidates: list[Candidate] = []
    for part in (chosen[:LEADERS], chosen[LEADERS:]):  # refits of the second part stop when far behind the first
        rival = min((c.fit.cost for c in candidates), default=fit.cost)
        done = len(candidates)

        def finished(k: int, c: Candidate, done=done) -> None:
            search.progress(
                "refitting effects",
                done + k,
                len(chosen),
                effect=c.kind.name,
                held_out_error=search.milli(c.held_out.error),
            )
            search.cache.keep(f"{step} + {c.kind.name}", c.fit.x, c.problem.hold)

        cached = [search.cache.get(f"{step} + {item.kind.name}") for item in part]
        calls = [
            (model, item, problem, search.train, search.test, search.both_rules, rival, k, search.by_pieces)
            for item, k in zip(part, cached, strict=True)
        ]
        candidates += many(refit, calls, search.jobs, finished)
    search.rollouts += sum(c.rollouts for c in candidates)
    if not search.ranking:
        linear = {s.kind.name: s.score for s in screened}
        search.ranking = [
            Ranked(c.kind.name, float(np.mean(c.held_out.chi2)), *gain(held, c.held_out), linear[c.kind.name])
            for c in sorted(candidates, key=lambda c: c.held_out.score)
        ]
    return candidates


def _shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """The best of the screening, and what the first two may be confused with."""
    promising = [s for s in screened if s.score > 0.01]
    names = {s.kind.name for s in promising[:REFITS]}
    for s in promising[:2]:
        names |= set(s.kind.confused_with)
    return [s for s in promising if s.kind.name in names]


def _null(search: Search, state: SearchState) -> NullDistribution:
    """Null distribution of the model so far."""
    model, problem, fit = state.current
    null = draw_null(model, fit, problem, search.test, search.rng)
    search.rollouts += null.rollouts
    return null
