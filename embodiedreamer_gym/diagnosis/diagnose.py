"""diagnose: calibrate, ask whether the model is wrong, add the effect that lowers the held-out error, and judge."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate, polish, refit
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis, Ranked, summarise
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, gain
from embodiedreamer_gym.diagnosis.journal import Journal
from embodiedreamer_gym.diagnosis.null import Null, draw_null
from embodiedreamer_gym.diagnosis.parallel import many
from embodiedreamer_gym.diagnosis.revise import decided, placed, without_needless
from embodiedreamer_gym.diagnosis.screen import SEEN_SHARE, Screened, grounds, screen
from embodiedreamer_gym.diagnosis.verdict import ALARM, contenders, convinces, left_over, mends, pays
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.signals import with_effort_unit
from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.robot import RobotModel

MAX_SECONDS = 80.0  # of motion to learn from, and as much to judge by
REFITS = 5  # best of the screening that are refitted
LEADERS = 2  # of them that are refitted to the end
Progress = Callable[[str, int, float], None]


@dataclass
class Search:
    """A diagnosis under way: what is fixed, and what each step has left behind."""

    nominal: RobotModel
    train: Sequence[Recording]
    test: Sequence[Recording]
    catalogue: Mapping[str, type[Effect]]
    jobs: int
    progress: Progress
    both_rules: bool
    rng: np.random.Generator
    journal: Journal
    rollouts: int = 0
    ranking: list[Ranked] = field(default_factory=list)
    unobservable: tuple[str, ...] = ()


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


def diagnose(
    model: RobotModel,
    train: Sequence[Recording],
    test: Sequence[Recording],
    catalogue: Mapping[str, type[Effect]] | None = None,
    max_effects: int = 3,
    jobs: int = 2,
    max_seconds: float = MAX_SECONDS,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
    journal: str | Path | None = None,
) -> Diagnosis:
    """Find out which physical effects a model lacks, by free-run error on held-out recordings.

    catalogue: effects to consider (default: the model's); max_effects: the most that are added, one at a time, all
    parameters refitted each time; jobs: processes; max_seconds: of longer recordings the liveliest windows are used,
    but the errors reported are those of the whole held-out recordings; journal: a file that keeps finished refits, so
    that an interrupted diagnosis goes on where it was. The model is calibrated first.
    Raises: CalibrationError or SimulationError when the recordings do not fit the model.
    """
    begun = time.perf_counter()
    if not train or not test:
        raise CalibrationError("diagnose needs recordings to learn from and others, held out, to judge by.")
    both = with_effort_unit(model, [*train, *test])
    train, test = both[: len(train)], both[len(train) :]
    all_test, train, test = test, thin(train, max_seconds), thin(test, max_seconds)
    both = model.command_hold == "unknown" and any(r.command_hold == "unknown" for r in train)
    catalogue = catalogue or model.catalogue
    search = Search(model, train, test, catalogue, jobs, progress or (lambda *_: None), both,
                    rng or np.random.default_rng(0), Journal(journal, model, [*train, *test], catalogue))  # fmt: skip
    problem, fit = fit_least_squares(model, train, progress=search.progress)
    calibrated = finish(problem, fit, 0.0)
    search.rollouts += problem.rollouts
    base = evaluate(calibrated.model, test)
    search.progress("null distribution", 0, base.error)
    null = draw_null(calibrated.model, fit, problem, test, search.rng)
    search.rollouts += null.rollouts
    p_value = null.p_value(base.chi2)
    search.progress("screening", 0, base.error)
    screened = _screen(search, problem, fit, null, first=True)
    found = Found((calibrated.model, problem, fit), base, null)
    if p_value < ALARM:
        _add_effects(search, found, screened, max_effects)
        _revise(search, found)
    steps, tie, held, null = found.steps, found.tie, found.held, found.null
    verdict = _verdict(p_value, base, held, null, steps, tie)
    final = finish(found.current[1], found.current[2], 0.0, null.sway)
    return summarise(
        verdict=verdict, model=model, calibrated=calibrated, final=final, steps=steps, tie=tie, closest=found.closest,
        base=base, held=held, null=null, p_value=p_value, ranking=search.ranking,
        unobservable=search.unobservable, test=all_test, rollouts=search.rollouts, seconds=time.perf_counter() - begun,
    )  # fmt: skip


def _add_effects(
    search: Search, found: Found, screened: Sequence[Screened], max_effects: int
) -> None:  # fmt: skip
    """Add effects one at a time, all parameters refitted each time, until the model is as good as a faultless one."""
    while len(found.steps) < max_effects and found.wanting:
        held, null, further = found.held, found.null, bool(found.steps)
        if further:
            search.progress("screening", 0, held.error)
            screened = _screen(search, *found.current[1:], null, first=False)
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
        search.progress(f"+ {chosen.kind.name}", len(found.steps), chosen.held_out.error)


def _revise(search: Search, found: Found) -> None:
    """Drop an effect that others have made needless, decide between rivals for the first, take each off idle joints."""
    if not found.steps:
        return
    search.progress("second thoughts", len(found.steps), found.held.error)
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


def _screen(search: Search, problem: Problem, fit: Fit, null: Null, first: bool) -> list[Screened]:
    """Screen the catalogue; the first time also note what these sensors and this motion cannot show."""
    floor = np.sqrt(np.median(null.chi2, axis=0))
    before = problem.rollouts
    short, around = grounds(problem, fit, search.nominal)
    screened = screen(search.catalogue, around, short, floor, search.jobs)
    search.rollouts += short.rollouts - before + sum(s.rollouts for s in screened)
    if first:
        search.unobservable = tuple(sorted(s.kind.name for s in screened if s.visible < SEEN_SHARE))
    return screened


def _candidates(
    search: Search, screened: Sequence[Screened], model: RobotModel, problem: Problem, fit: Fit, held: HeldOut
) -> list[Candidate]:  # fmt: skip
    """Refit the best of the screening and all that they are confused with."""
    chosen, step = _shortlist(screened), f"{len(model.effects)} effects"
    candidates: list[Candidate] = []
    for part in (chosen[:LEADERS], chosen[LEADERS:]):  # the others are given up where they fall far behind the leaders
        rival = min((c.fit.cost for c in candidates), default=fit.cost)
        done = len(candidates)

        def finished(k: int, c: Candidate, done=done) -> None:
            search.progress(f"refit {c.kind.name} ({done + k} of {len(chosen)})", done + k, c.held_out.error)
            search.journal.keep(f"{step} + {c.kind.name}", c.fit.x, c.problem.hold)

        known = [search.journal.known(f"{step} + {item.kind.name}") for item in part]
        calls = [
            (model, item, problem, search.train, search.test, search.both_rules, rival, k)
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


def _verdict(p_value, base, held, null, steps, tie) -> str:
    if p_value >= ALARM:
        return "nothing_missing"
    if not steps:
        return "unknown"
    if not convinces(base, held, null.chi2):
        return "unknown"
    return "ambiguous" if tie else "missing"


def _null(search: Search, found: Found) -> Null:
    """How faultless robots like the model so far do."""
    model, problem, fit = found.current
    null = draw_null(model, fit, problem, search.test, search.rng)
    search.rollouts += null.rollouts
    return null
