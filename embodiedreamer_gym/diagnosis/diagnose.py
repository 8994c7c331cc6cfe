"""diagnose: calibrate, ask whether the model is wrong, add the effect that lowers the held-out error, and judge."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate, polish, prune, refit
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis, Ranked, summarise
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, gain
from embodiedreamer_gym.diagnosis.null import Null, draw_null
from embodiedreamer_gym.diagnosis.parallel import many
from embodiedreamer_gym.diagnosis.screen import SEEN_SHARE, Screened, grounds, screen
from embodiedreamer_gym.diagnosis.verdict import ALARM, contenders, convinces, mends, pays
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner import Calibration
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
    rollouts: int = 0
    ranking: list[Ranked] = field(default_factory=list)
    unobservable: tuple[str, ...] = ()


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
) -> Diagnosis:
    """Find out which physical effects a model lacks, by free-run error on held-out recordings.

    catalogue: effects to consider (default: the model's); max_effects: the most that are added, one at a time, all
    parameters refitted each time; jobs: threads; max_seconds: of longer recordings the liveliest windows are used,
    but the errors reported are those of the whole held-out recordings. The model is calibrated first.
    Raises: CalibrationError or SimulationError when the recordings do not fit the model.
    """
    begun = time.perf_counter()
    if not train or not test:
        raise CalibrationError("diagnose needs recordings to learn from and others, held out, to judge by.")
    both = with_effort_unit(model, [*train, *test])
    train, test = both[: len(train)], both[len(train) :]
    all_test, train, test = test, thin(train, max_seconds), thin(test, max_seconds)
    both = model.command_hold == "unknown" and any(r.command_hold == "unknown" for r in train)
    search = Search(model, train, test, catalogue or model.catalogue, jobs, progress or (lambda *_: None), both,
                    rng or np.random.default_rng(0))  # fmt: skip
    problem, fit = fit_least_squares(model, train, progress=search.progress)
    calibrated = finish(problem, fit, 0.0)
    search.rollouts += problem.rollouts
    base = evaluate(calibrated.model, test)
    search.progress("null distribution", 0, base.error)
    null = draw_null(calibrated.model, fit, problem, test, search.rng)
    search.rollouts += null.rollouts
    p_value = null.p_value(base.chi2)
    steps: list[Candidate] = []
    tie: list[Candidate] = []
    closest: Candidate | None = None
    current, held = (calibrated.model, problem, fit), base
    while len(steps) < max_effects and (p_value if not steps else null.p_value(held.chi2)) < ALARM:
        candidates = _candidates(search, *current, held, null, first=not steps)
        worthy = [c for c in candidates if pays(held, c.held_out) and (not steps or mends(held, c.held_out, null.chi2))]
        if candidates and closest is None:
            closest = min(candidates, key=lambda c: c.held_out.score)
        if not worthy:
            break
        close = contenders(held, worthy)
        if len(close) > 1 and not steps:
            tie = close
        chosen = polish(prune(close[0], train, test), test)
        search.rollouts += chosen.rollouts - close[0].rollouts
        steps.append(chosen)
        current, held = (chosen.model, chosen.problem, chosen.fit), chosen.held_out
        search.progress(f"+ {chosen.kind.name}", len(steps), held.error)
        if tie:
            break
    verdict = _verdict(p_value, base, held, null, steps, tie)
    final = _final(calibrated, steps)
    return summarise(
        verdict=verdict, model=model, calibrated=calibrated, final=final, steps=steps, tie=tie, closest=closest,
        base=base, held=held, null=null, p_value=p_value, ranking=search.ranking,
        unobservable=search.unobservable, test=all_test, rollouts=search.rollouts, seconds=time.perf_counter() - begun,
    )  # fmt: skip


def _candidates(
    search: Search, model: RobotModel, problem: Problem, fit: Fit, held: HeldOut, null: Null, first: bool
) -> list[Candidate]:  # fmt: skip
    """Screen the catalogue, refit the best of it and all that they are confused with."""
    floor = np.sqrt(np.median(null.chi2, axis=0))
    search.progress("screening", 0, held.error)
    before = problem.rollouts
    short, around = grounds(problem, fit, search.nominal if first else None)
    screened = screen(search.catalogue, around, short, floor, search.jobs)
    search.rollouts += short.rollouts - before + sum(s.rollouts for s in screened)
    if first:
        search.unobservable = tuple(sorted(s.kind.name for s in screened if s.visible < SEEN_SHARE))
    chosen = _shortlist(screened)
    candidates: list[Candidate] = []
    for part in (chosen[:LEADERS], chosen[LEADERS:]):  # the others are given up where they fall far behind the leaders
        rival = min((c.fit.cost for c in candidates), default=fit.cost)
        done, of = len(candidates), len(chosen)
        candidates += many(
            refit,
            [(model, item, problem, search.train, search.test, search.both_rules, rival) for item in part],
            search.jobs,
            lambda k, c, done=done, of=of: search.progress(
                f"refit {c.kind.name} ({done + k} of {of})", done + k, c.held_out.error
            ),
        )
    search.rollouts += sum(c.rollouts for c in candidates)
    if first:
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


def _final(calibrated: Calibration, steps: Sequence[Candidate]) -> Calibration:
    """The last step as a calibration, with intervals."""
    return finish(steps[-1].problem, steps[-1].fit, 0.0) if steps else calibrated
