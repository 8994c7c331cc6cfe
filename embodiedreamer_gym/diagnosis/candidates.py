"""Refit: a model with one more effect, all parameters fitted again, judged on held-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate
from embodiedreamer_gym.diagnosis.refit_cache import Known
from embodiedreamer_gym.diagnosis.screening import Screened
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.least_squares import Fit, fit_at, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.starts import piecewise_start
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel

ITERATIONS = 12
TOLERANCE = 1e-3
HIGHER = 1.35  # times the best size of a limit in the screening: the next start
POLISH, POLISHED = 25, 1e-4
TRIFLE = 0.08  # held-out score of a joint that is not worth naming it
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
    def trained(self) -> np.ndarray:
        """chi2 (n,) on the training recordings."""
        return self.problem.joint_rms(self.fit.residuals)[0] ** 2


def refit(
    base: RobotModel, screened: Screened, problem: Problem, train: Sequence[Recording], test: Sequence[Recording],
    both_rules: bool, rival: float = np.inf, known: Known | None = None, by_pieces: bool = False,
) -> Candidate:  # fmt: skip
    """Fit base + effect from where the screening found it; under both rules between commands where none is known.

    problem: the base model's own, whose weights per joint and rule are kept, so that costs compare; rival: cost of another
    refit, far above which this one is given up; known: where this refit ended once before; by_pieces: begin with fits to
    pieces of the motion, also from nominal gains, where a fit to the whole would end in a wrong valley.
    """
    trial = base.with_effect(screened.kind, screened.joints)
    options = RULES if both_rules and screened.kind.stage == "command" else (problem.hold,)
    if known is not None:
        options = (known.hold,)
    found: list[Candidate] = []
    starts = _starts(screened) if known is None else [screened.start]
    for hold in options:
        new = Problem(trial, train, hold=hold)
        scaled = [start_of(new, start) for start in starts]
        if by_pieces and known is None:
            scaled = [piecewise_start(new, [*scaled, start_of(new, screened.start | screened.nominal)])]
        for x in scaled:
            fit = fit_at(new, known.x) if known else minimise(new, x, ITERATIONS, TOLERANCE, rival=rival)
            model = new.model_at(fit.x)
            found.append(Candidate(screened.kind, model, new, fit, evaluate(model, test, hold), new.rollouts))
    best = min(found, key=lambda c: c.fit.cost)
    return replace(best, rollouts=sum({id(c.problem): c.problem.rollouts for c in found}.values()))


def _starts(screened: Screened) -> list[dict[ParameterKey, np.ndarray]]:
    """Where the screening found an effect; a limit also a little higher, since its cost has more than one valley."""
    higher = dict(screened.start)
    for p in screened.kind.parameters:
        if p.off == p.high:
            key = ParameterKey(p.name, screened.kind.name)
            higher[key] = HIGHER * screened.start[key]
    same = all(higher[group] is values for group, values in screened.start.items())
    return [screened.start] if same else [screened.start, higher]


def start_of(problem: Problem, start: dict[ParameterKey, np.ndarray]) -> np.ndarray:
    """Scaled start (m,) of a problem: the model's own values, but those of `start` (group -> values) where given."""
    values = np.array([start[r.key.group][r.index] if r.key.group in start else r.value for r in problem.rows])
    return np.clip(problem.scale(np.clip(values, *_bounds(problem))), problem.lower, problem.upper)


def _bounds(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    return np.array([row.low for row in problem.rows]), np.array([row.high for row in problem.rows])


def prune(
    candidate: Candidate, train: Sequence[Recording], test: Sequence[Recording], share: float = 0.1
) -> Candidate:  # fmt: skip
    """Keep the effect only on the joints (or arms) where switching it off costs held-out score, and refit.

    A joint stays when switching it off alone loses more than `share` of what the dearest joint loses, both as it stands
    and if all other parameters could answer (linearly); the latter alone counts where held-out motion feels no joint, as
    of a limit that it does not reach. The smaller effect is taken unless it does worse on the held-out
    recordings.
    """
    kind, model = candidate.kind, candidate.model
    effect = next(e for e in model.effects if e.name == kind.name)
    places = sorted({place for values in effect.values.values() for place in values}, key=_order(model))
    if len(places) < 2:
        return candidate
    losses, answered = [], []
    for place in places:
        values = {
            ParameterKey(p.name, kind.name): {place: float(model.parameter_off(p)[model.places(p).index(place)])}
            for p in kind.parameters if place in model.places(p)
        }  # fmt: skip
        off = evaluate(model.with_values(values), test, candidate.problem.hold)
        answered.append(_answered_loss(candidate, place))
        losses.append(min(off.score - candidate.held_out.score, answered[-1]))
    keep = _dear(places, losses, share) or _dear(places, answered, share)
    spent = candidate.rollouts + len(places)
    if not keep or len(keep) == len(places):
        return replace(candidate, rollouts=spent)
    smaller = kind(**{k: {j: v for j, v in values.items() if j in keep} for k, values in effect.values.items()})
    trimmed = model.with_(effects=(*(e for e in model.effects if e.name != kind.name), smaller))
    new = Problem(trimmed, train, hold=candidate.problem.hold)
    fit = minimise(new, new.start, ITERATIONS, TOLERANCE)
    fitted = new.model_at(fit.x)
    held_out = evaluate(fitted, test, new.hold)
    spent += new.rollouts
    if held_out.score > candidate.held_out.score + TRIFLE * (len(places) - len(keep)):
        return replace(candidate, rollouts=spent)
    return Candidate(kind, fitted, new, fit, held_out, spent)


def _dear(places: Sequence[str], losses: Sequence[float], share: float) -> list[str]:
    """Places whose loss is no trifle, beside the dearest."""
    return [p for p, loss in zip(places, losses, strict=True) if loss > max(share * max(losses), TRIFLE)]


def _answered_loss(candidate: Candidate, place: str) -> float:
    """Loss of training score when the effect is switched off on one joint (or arm) and the other parameters answer.

    Half the squared distance from off in units of the estimate's covariance, whose Hessian is that of the sum over
    joints of log(1 + chi2). An effect that is off at a bound far away (a limit) looks dearer than it is.
    """
    problem, fit = candidate.problem, candidate.fit
    keys = [row.key for row in problem.rows]
    own = np.array([i for i, key in enumerate(keys) if (key.effect, key.place) == (candidate.kind.name, place)], int)
    off = problem.scale(np.array([r.value if r.off is None else r.off for r in problem.rows]))[own]
    weighted = fit.jacobian * (fit.weight / np.sqrt(problem.joint_counts[problem.joint_of]))[:, None]
    free = (fit.x > problem.lower + 1e-9) & (fit.x < problem.upper - 1e-9)
    free[own] = False
    own_part, others = weighted[:, own], weighted[:, free]
    left = own_part - others @ np.linalg.lstsq(others, own_part, rcond=1e-6)[0]
    return 0.5 * float(np.sum((left @ (fit.x[own] - off)) ** 2))


def polish(candidate: Candidate, test: Sequence[Recording]) -> Candidate:
    """Fit to the end what was only fitted well enough to be compared, so that no other effect has to mend it."""
    problem = candidate.problem
    spent = problem.rollouts
    fit = minimise(problem, candidate.fit.x, POLISH, POLISHED)
    model = problem.model_at(fit.x)
    held_out = evaluate(model, test, problem.hold)
    return replace(
        candidate, model=model, fit=fit, held_out=held_out, rollouts=candidate.rollouts + problem.rollouts - spent
    )


def _order(model: RobotModel):
    names = (*model.joints, *model.arms)
    return names.index
