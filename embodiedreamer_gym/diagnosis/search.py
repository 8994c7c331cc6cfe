"""The search of a diagnosis: screen, refit, add what pays, again, and second thoughts at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from embodiedreamer_gym.diagnosis.backward_elimination import decided, placed, without_needless
from embodiedreamer_gym.diagnosis.candidates import Candidate, polish, refit
from embodiedreamer_gym.diagnosis.diagnosis import Ranked
from embodiedreamer_gym.diagnosis.held_out import HeldOut, gain
from embodiedreamer_gym.diagnosis.null_distribution import Null, draw_null
from embodiedreamer_gym.diagnosis.refit_cache import Journal
from embodiedreamer_gym.diagnosis.screening import SEEN_SHARE, Screened, grounds, screen
from embodiedreamer_gym.diagnosis.verdict import ALARM, contenders, convinces, left_over, mends, pays
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.io.parallel import many
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

REFITS = 5  # best of the screening that are refitted
LEADERS = 2  # of them that are refitted to the end


@dataclass
class Search:
    """A diagnosis under way: what is fixed, how refits begin, and what each step has left behind."""

    nominal: RobotModel
    train: Sequence[Recording]
    test: Sequence[Recording]
    catalogue: Mapping[str, type[Effect]]
    jobs: int
    progress: ProgressCallback
    both_rules: bool
    rng: np.random.Generator
    journal: Journal
    unit: str
    by_pieces: bool = False
    rollouts: int = 0
    ranking: list[Ranked] = field(default_factory=list)
    unobservable: tuple[str, ...] = ()

    def milli(self, error: float) -> str:
        """A held-out error as "1.23 mrad"."""
        return milli(error, self.unit)


@dataclass
class Found:
    """What a search has added: the model at its start, its steps, rivals for the first of them, the best alone; and
    how faultless robots like the model so far do.
    """

    start: tuple[RobotModel, Problem, Fit]
    base: HeldOut
    null: Null
    steps: list[Candidate] = field(default_factory=list)
    tie: list[Candidate] = field(default_factory=list)
    closest: Candidate | None = None

    @property
    def current(self) -> tuple[RobotModel, Problem, Fit]:
        """Model, problem and fit so far."""
        return (self.steps[-1].model, self.steps[-1].problem, self.steps[-1].fit) if self.steps else self.start

    @property
    def wanting(self) -> bool:
        """Whether the model so far is worse than faultless robots are."""
        alarm = self.null.p_value(self.held.chi2) < ALARM
        return alarm or (bool(self.steps) and left_over(self.held, self.null.chi2))

    @property
    def held(self) -> HeldOut:
        """How the model so far does on the held-out recordings."""
        return self.steps[-1].held_out if self.steps else self.base


def look(search: Search, found: Found, screened: Sequence[Screened], max_effects: int) -> Found:
    """Add effects and think again; where that does not convince, once more by pieces, to get out of wrong valleys."""
    begun = replace(found, steps=[], tie=[])
    add_effects(search, found, screened, max_effects)
    revise(search, found)
    if convinces(found.base, found.held, found.null.chi2):
        return found
    first = search.ranking
    search.by_pieces, search.ranking = True, []
    add_effects(search, begun, screened, max_effects)
    revise(search, begun)
    if begun.held.score < found.held.score:
        return begun
    search.ranking = first
    return found


def add_effects(
    search: Search, found: Found, screened: Sequence[Screened], max_effects: int
) -> None:  # fmt: skip
    """Add effects one at a time, all parameters refitted each time, until the model is as good as a faultless one."""
    while len(found.steps) < max_effects and found.wanting:
        held, null, further = found.held, found.null, bool(found.steps)
        if further:
            screened = screen_all(search, *found.current[1:], null, first=False)
        candidates = _candidates(search, screened, *found.current, held)
        worthy = [
            c for c in candidates if pays(held, c.held_out) and (not further or mends(held, c.held_out, null.chi2))
        ]
        if candidates and found.closest is None:
            found.closest = min(candidates, key=lambda c: c.held_out.score)
        if not worthy:
            return
        close = contenders(held, worthy)
        if not further and len(close) > 1:
            found.tie = close
        chosen = polish(close[0], search.test)
        search.rollouts += chosen.rollouts - close[0].rollouts
        found.steps.append(chosen)
        found.null = _null(search, found)
        search.progress(
            f"added {chosen.kind.name}",
            len(found.steps),
            max_effects,
            held_out_error=search.milli(chosen.held_out.error),
        )


def revise(search: Search, found: Found) -> None:
    """Drop an effect that others have made needless, decide between rivals for the first, take each off idle joints."""
    if not found.steps:
        return
    search.progress("backward elimination", 0, len(found.steps), held_out_error=search.milli(found.held.error))
    spent, first = sum(s.rollouts for s in found.steps), found.steps[0]
    if len(found.steps) > 1:
        found.steps = without_needless(found.steps, search.train, search.test)
        if found.steps[0] is not first:
            found.tie = []
    if found.tie and len(found.steps) > 1:
        found.steps, close = decided(found.base, found.tie, found.steps, search.train, search.test)
        found.tie = close if len(close) > 1 else []
    found.steps = placed(found.steps, search.train, search.test)
    found.steps[-1] = polish(found.steps[-1], search.test)
    search.rollouts += sum(s.rollouts for s in found.steps) - spent
    found.null = _null(search, found)


def screen_all(search: Search, problem: Problem, fit: Fit, null: Null, first: bool) -> list[Screened]:
    """Screen the catalogue; the first time also note what these sensors and this motion cannot show."""
    floor = np.sqrt(np.median(null.chi2, axis=0))
    before = problem.rollouts
    short, around = grounds(problem, fit, search.nominal)
    screened = screen(search.catalogue, around, short, floor, search.jobs, search.progress)
    search.rollouts += short.rollouts - before + sum(s.rollouts for s in screened)
    if first:
        search.unobservable = tuple(sorted(s.kind.name for s in screened if s.visible < SEEN_SHARE))
    return screened


def _candidates(
    search: Search, screened: Sequence[Screened], model: RobotModel, problem: Problem, fit: Fit, held: HeldOut
) -> list[Candidate]:  # fmt: skip
    """Refit the best of the screening and all that they are confused with."""
    chosen, step = _shortlist(screened), f"{len(model.effects)} effects{', by pieces' * search.by_pieces}"
    candidates: list[Candidate] = []
    for part in (chosen[:LEADERS], chosen[LEADERS:]):  # the others are given up where they fall far behind the leaders
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
            search.journal.keep(f"{step} + {c.kind.name}", c.fit.x, c.problem.hold)

        known = [search.journal.known(f"{step} + {item.kind.name}") for item in part]
        calls = [
            (model, item, problem, search.train, search.test, search.both_rules, rival, k, search.by_pieces)
            for item, k in zip(part, known, strict=True)
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
    """The best of the screening, and the siblings of the first two."""
    promising = [s for s in screened if s.score > 0.01]
    names = {s.kind.name for s in promising[:REFITS]}
    for s in promising[:2]:
        names |= set(s.kind.confused_with)
    return [s for s in promising if s.kind.name in names]


def _null(search: Search, found: Found) -> Null:
    """How faultless robots like the model so far do."""
    model, problem, fit = found.current
    null = draw_null(model, fit, problem, search.test, search.rng)
    search.rollouts += null.rollouts
    return null
