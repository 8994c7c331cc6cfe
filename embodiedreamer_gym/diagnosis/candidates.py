"""Refit: a model with one more effect, all parameters fitted again, judged on held-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, score
from embodiedreamer_gym.diagnosis.refit_cache import CachedFit
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.least_squares import Fit, fit_at, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.starts import piecewise_start
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel

ITERATIONS = 12
TOLERANCE = 1e-3
HIGHER_LIMIT = 1.35  # second start of a limit, relative to its best size in the screening
FINAL_ITERATIONS, FINAL_TOLERANCE = 25, 1e-4
RULES = ("linear", "hold")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A refitted model: the effect added last, its fit, and how it does on the held-out recordings."""

    kind: type[Effect]
    model: RobotModel
    problem: Problem
    fit: Fit
    held_out: HeldOut
    rollouts: int

    @property
    def trained_score(self) -> float:
        """The score of a `HeldOut`, on the training recordings."""
        return score(self.problem.joint_rms(self.fit.residuals)[0] ** 2, self.problem.sigma)


def refit(
    base: RobotModel, screened: Screened, problem: Problem, train: Sequence[Recording], test: Sequence[Recording],
    both_rules: bool, rival: float = np.inf, cached: CachedFit | None = None, by_pieces: bool = False,
) -> Candidate:  # fmt: skip
    """Fit base + effect from the screening's start; under both rules between commands where the recordings name none.

    problem: the base model's own, whose weights per joint and rule are kept, so that costs compare; rival: cost of another
    refit, far above which this one is given up; cached: where this refit ended once before; by_pieces: begin with fits to
    pieces of the motion, also from nominal gains, where a fit to the whole would end in a local minimum.
    """
    trial = base.with_effect(screened.kind, screened.joints)
    options = RULES if both_rules and screened.kind.stage == "command" else (problem.hold,)
    if cached is not None:
        options = (cached.hold,)
    fits: list[Candidate] = []
    starts = _starts(screened) if cached is None else [screened.start]
    for hold in options:
        new = Problem(trial, train, hold=hold)
        scaled = [start_of(new, start) for start in starts]
        if by_pieces and cached is None:
            scaled = [piecewise_start(new, [*scaled, start_of(new, screened.start | screened.nominal)])]
        for x in scaled:
            if cached and len(cached.x) != len(x):
                raise CalibrationError(f"the refit cache does not fit {screened.kind.name}; give another file.")
            fit = fit_at(new, cached.x) if cached else minimise(new, x, ITERATIONS, TOLERANCE, rival=rival)
            model = new.model_at(fit.x)
            fits.append(Candidate(screened.kind, model, new, fit, evaluate(model, test, hold), new.rollouts))
    best = min(fits, key=lambda c: c.fit.cost)
    return replace(best, rollouts=sum({id(c.problem): c.problem.rollouts for c in fits}.values()))


def _starts(screened: Screened) -> list[dict[ParameterKey, np.ndarray]]:
    """Starts of a refit: the screening's best; of a limit also a higher one, since its cost has several local minima."""
    higher = dict(screened.start)
    for p in screened.kind.parameters:
        if p.off == p.high:
            key = ParameterKey(p.name, screened.kind.name)
            higher[key] = HIGHER_LIMIT * screened.start[key]
    same = all(higher[group] is values for group, values in screened.start.items())
    return [screened.start] if same else [screened.start, higher]


def start_of(problem: Problem, start: dict[ParameterKey, np.ndarray]) -> np.ndarray:
    """Scaled start (m,) of a problem: the model's own values, but those of `start` (group -> values) where given."""
    values = np.array([start[r.key.group][r.index] if r.key.group in start else r.value for r in problem.rows])
    return np.clip(problem.scale(np.clip(values, *_bounds(problem))), problem.lower, problem.upper)


def _bounds(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    return np.array([row.low for row in problem.rows]), np.array([row.high for row in problem.rows])


def polish(candidate: Candidate, test: Sequence[Recording]) -> Candidate:
    """Continue a refit to a finer tolerance, so that no later effect makes up for it."""
    problem = candidate.problem
    spent = problem.rollouts
    fit = minimise(problem, candidate.fit.x, FINAL_ITERATIONS, FINAL_TOLERANCE)
    model = problem.model_at(fit.x)
    held_out = evaluate(model, test, problem.hold)
    return replace(
        candidate, model=model, fit=fit, held_out=held_out, rollouts=candidate.rollouts + problem.rollouts - spent
    )
