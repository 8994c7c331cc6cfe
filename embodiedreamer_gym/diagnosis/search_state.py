"""State of a running diagnosis, and the common steps: screen, draw faultless robots, find the most likely candidate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import HeldOut, pooled
from embodiedreamer_gym.diagnosis.null_distribution import NullDistribution, draw_null
from embodiedreamer_gym.diagnosis.probabilities import candidate_probabilities
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.screening import VISIBLE_SHARE, LinearisationPoint, Screened, linearise, screen
from embodiedreamer_gym.diagnosis.verdict import ALARM, EXACT, INEXACT, RICHER, brings_little, improves, leaves_excess
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

HARDLY = 0.01  # share of the whole gain; a law that brings less beyond an exact special case is not preferred to it
LARGE = 100.0  # multiple of the 95 % quantile of faultless robots above which RICHER takes the place of HARDLY
SURE = 0.95  # probability above which an effect is named


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

    both_rules: whether refits try both rules between two commands; linearised: the first screening's problem and the
    point around which pairs are screened; whole_test: the held-out recordings at their full length.
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
    whole_test: Sequence[Recording] = ()
    unit: str = "rad"
    linearised: tuple[Problem, LinearisationPoint] | None = None
    rollouts: int = 0
    ranking: list[Ranked] = field(default_factory=list)
    unobservable: tuple[str, ...] = ()

    def milli(self, error: float) -> str:
        """A held-out error as "1.23 mrad"."""
        return milli(error, self.unit)


@dataclass
class SearchState:
    """The calibrated start of a search and the effects added to it.

    base, trained: errors of the start on held-out motion and on the fitted motion; null: of faultless robots like the
    current model; start_null: like the start; steps: one candidate per added effect; closest: best single effect;
    probabilities: of each effect, given that one of the candidates is right; tie: the effects of which one is missing,
    if no single one is probable enough; rivals: candidates for the first step that held-out motion does not
    distinguish, if efforts are compared; together: errors on the fitted and on the held-out motion of a fit to both,
    see `exactness.fit_together`; exact_beside: whether one effect leaves only noise in a fit with nuisance parameters;
    unseen: a single effect that the training motion supports and held-out motion rejects, see
    `unseen_motion.contradicted`.
    """

    start: tuple[RobotModel, Problem, Fit]
    base: HeldOut
    trained: HeldOut
    null: NullDistribution
    steps: list[Candidate] = field(default_factory=list)
    tie: tuple[str, ...] = ()
    rivals: list[Candidate] = field(default_factory=list)
    closest: Candidate | None = None
    probabilities: dict[str, float] = field(default_factory=dict)
    together: tuple[HeldOut, HeldOut] | None = None
    exact_beside: bool = False
    unseen: Candidate | None = None

    def __post_init__(self) -> None:
        self.start_null = self.null

    @property
    def by_effort(self) -> bool:
        """Whether efforts are compared, not positions."""
        return self.start[1].signals.by_effort

    @property
    def current(self) -> tuple[RobotModel, Problem, Fit]:
        """Current model, problem and fit."""
        return (self.steps[-1].model, self.steps[-1].problem, self.steps[-1].fit) if self.steps else self.start

    @property
    def is_wrong(self) -> bool:
        """Whether the current model is worse than faultless robots."""
        alarm = self.null.p_value(self.held.chi2, self.fitted.chi2) < ALARM
        return alarm or (bool(self.steps) and not self.is_exact)

    @property
    def excess(self) -> float:
        """The worst joint's error relative to that of faultless robots, see `NullDistribution.excess`."""
        if self.together is None:
            return self._alone
        return min(self._alone, self.null.excess(self.together[1].chi2, self.together[0].chi2))

    @property
    def _alone(self) -> float:
        """The same for the fit to the training motion alone."""
        return self.null.excess(self.held.chi2, self.fitted.chi2)

    @property
    def is_exact(self) -> bool:
        """Whether no joint is worse than the joints of faultless robots usually are."""
        if self.by_effort:
            return bool(self.steps) and not leaves_excess(self.held, self.null.chi2)
        return bool(self.steps) and (self.excess <= EXACT or self.exact_beside)

    @property
    def is_wrong_unseen(self) -> bool:
        """Whether the current model is exact on the motion that it was fitted to, but not on held-out motion."""
        return not self.by_effort and self.is_exact_on_fitted(self.fitted) and self._alone > EXACT

    def is_exact_on_fitted(self, errors: HeldOut) -> bool:
        """Whether errors on the fitted motion are no larger than those of faultless robots."""
        return self.null.excess(np.zeros_like(errors.chi2), errors.chi2) <= EXACT

    @property
    def needs_all_motion(self) -> bool:
        """Whether the current model is exact, but only if it is fitted to held-out motion too."""
        return self.together is not None and self.is_exact

    @property
    def judged(self) -> HeldOut:
        """Error on all motion, which decides whether effects are accepted."""
        return self.steps[-1].judged if self.steps else self.judged_start

    @property
    def most(self) -> np.ndarray:
        """Largest chi2 (n,) of all but 5 % of faultless robots."""
        return np.maximum(*(np.quantile(chi2, 0.95, axis=0) for chi2 in (self.null.chi2, self.null.trained_chi2)))

    @property
    def judged_start(self) -> HeldOut:
        """The same for the start."""
        return pooled(self.trained, self.base)

    def improving(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Candidates that improve on the current model on all motion or, if there are none, on the fitted motion.

        Parameters that the fitted motion does not determine may be wrong on held-out motion.
        """
        chosen = [c for c in candidates if improves(self.judged, c.judged, self.most)]
        return chosen or [c for c in candidates if improves(self.fitted, c.trained, self.most)]

    def set_rivals(self, close: Sequence[Candidate]) -> None:
        """Store the candidates for the first step that tie; a single one is no tie."""
        self.rivals = list(close) if len(close) > 1 else []
        self.tie = tuple(c.kind.name for c in self.rivals)

    @property
    def held(self) -> HeldOut:
        """Held-out error of the current model."""
        return self.steps[-1].held_out if self.steps else self.base

    @property
    def fitted(self) -> HeldOut:
        """Error of the current model on the motion that it was fitted to."""
        return self.steps[-1].trained if self.steps else self.trained


def screen_all(
    search: Search, problem: Problem, fit: Fit, null: NullDistribution, first: bool,
    catalogue: Mapping[str, type[Effect]] | None = None, at_nominal: bool = True,
) -> list[Screened]:  # fmt: skip
    """Screen the catalogue; the first time also note what these sensors and this motion cannot show.

    catalogue: effects to screen, if not all; at_nominal: whether they are tried with the nominal gains too.
    """
    floor = np.sqrt(np.median(null.chi2, axis=0))
    before = problem.rollouts
    short, points = linearise(problem, fit, search.nominal if at_nominal else None)
    if first:
        search.linearised = (short, points[-1])
    screened = screen(
        search.catalogue if catalogue is None else catalogue, points, short, floor, search.jobs, search.progress
    )
    search.rollouts += short.rollouts - before + sum(s.rollouts for s in screened)
    if first:
        search.unobservable = tuple(s.kind.name for s in screened if s.visible < VISIBLE_SHARE)
    return screened


def current_null(search: Search, state: SearchState) -> NullDistribution:
    """Null distribution of the current model."""
    model, problem, fit = state.current
    null = draw_null(model, fit, problem, search.test, search.rng)
    search.rollouts += null.rollouts
    return null


def likeliest(search: Search, state: SearchState, candidates: Sequence[Candidate]) -> Candidate:
    """The most probable candidate; also stores the probabilities of the effects, and the tie if none is certain.

    A law is not among them if a special case of it is exact and the law brings hardly anything beyond it.
    """
    candidates = [c for c in candidates if not any(_is_enough(state, one, c) for one in candidates)]
    seconds = (sum(r.duration for r in search.train), sum(r.duration for r in search.test))
    shares = candidate_probabilities(
        state.start[0],
        (state.trained, state.base),
        candidates,
        seconds,
        (len(search.train), len(search.test)),
        search.rng,
    )
    state.probabilities = {}
    for candidate, share in zip(candidates, shares, strict=True):
        for name in added_effects(state.start[0], candidate.model):
            state.probabilities[name] = state.probabilities.get(name, 0.0) + float(share)
    state.probabilities = dict(sorted(state.probabilities.items(), key=lambda item: -item[1]))
    best = candidates[int(np.argmax(shares))]
    if max(shares) < SURE:  # if a law and its special case tie, the special case is enough
        plain = [c for c, p in zip(candidates, shares, strict=True) if p > 1 - SURE and _is_special_case(c, best)]
        best = plain[0] if plain else best
    names = added_effects(state.start[0], best.model)
    contain = {name for name, kind in search.catalogue.items() if set(kind.generalises) & set(names)}
    open_names = [name for name, p in state.probabilities.items() if p > 1 - SURE and name not in contain]
    open_names.sort(
        key=lambda name: state.probabilities[name] >= SURE
    )  # certain effects last: no motion has to decide on them
    state.tie = () if set(open_names) <= set(names) else tuple(open_names)
    return best


def _is_enough(state: SearchState, special_case: Candidate, richer: Candidate) -> bool:
    """Whether a special case of a law explains the error, and the law hardly more.

    A large effect leaves some error if its law is only nearly exact, for example by the time steps of the simulation,
    and a richer law absorbs a part of it. So if the error was large, the special case need not be quite exact.
    """
    if special_case is richer or not _is_special_case(special_case, richer) or state.by_effort:
        return False
    left = state.null.excess(special_case.held_out.chi2, special_case.trained.chi2)
    large = state.null.excess(state.base.chi2, state.trained.chi2) > LARGE
    most, share = (INEXACT, RICHER) if large else (EXACT, HARDLY)
    return left <= most and brings_little(state.judged_start, special_case.judged, richer.judged, share)


def _is_special_case(one: Candidate, other: Candidate) -> bool:
    """Whether two models differ in one effect, and that of `one` is a special case of that of `other`."""
    mine, theirs = ({e.name: type(e) for e in c.model.effects} for c in (one, other))
    own, rest = mine.keys() - theirs.keys(), theirs.keys() - mine.keys()
    return len(own) == len(rest) == 1 and own <= set(theirs[rest.pop()].generalises)


def added_effects(base: RobotModel, model: RobotModel) -> list[str]:
    """Names of the effects of a model that the base model lacks."""
    return [e.name for e in model.effects if not base.has_effect(type(e))]
