"""Pairs of effects: all of them scored in the linearised model, and the best refitted from a grid of two sizes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import ITERATIONS, TOLERANCE, Candidate
from embodiedreamer_gym.diagnosis.effect_starts import Values, sizes_of, start_of
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.screening import LinearisationPoint, Screened, own_gains
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel

MOST = 1.5  # share of a change of the residuals that the linear model may take
SIZES = (0.2, 0.5, 1.0, 2.0, 3.5, 6.0)  # of each effect, relative to its typical size
LIMITS = (0.6, 0.8, 1.0, 1.25, 1.6, 2.0)  # of a limit, relative to what the linear model found


@dataclass(frozen=True, eq=False)
class ScreenedPair:
    """Two effects, the fall of the summed log residual by both (linear), and values to begin with: group -> values."""

    kinds: tuple[type[Effect], type[Effect]]
    score: float
    start: dict[ParameterKey, np.ndarray]


def screen_pairs(
    screened: Sequence[Screened], point: LinearisationPoint, problem: Problem, floor: np.ndarray, count: int
) -> list[ScreenedPair]:
    """The best pairs of screened effects, by what both together leave at each joint in the linearised model.

    Of a joint's residual, after its own gains have answered, shares in [0, 1.5] of one size of each effect are taken off.
    A pair in which one law contains the other is none.
    floor (n,): root-mean-square residual, in sensor noises, below which a joint has nothing left to explain.
    """
    n = problem.model.n
    owner = np.concatenate([np.full(len(s.change), k) for k, s in enumerate(screened)])
    first = np.concatenate([[0], np.cumsum([len(s.change) for s in screened])])
    changes = np.concatenate([s.change for s in screened])
    left = np.zeros((n, len(screened), len(screened)))
    where = np.zeros((n, len(screened), len(screened), 2), int)
    shares = []
    for j in range(n):
        rows = np.flatnonzero(problem.joint_of == j)
        if len(rows) < 10:
            shares.append((np.zeros((len(owner),) * 2),) * 2)
            continue
        basis = own_gains(problem, point, rows, j)
        r, d = point.residuals[rows], changes[:, rows]
        r, d = r - basis @ (basis.T @ r), d - (d @ basis) @ basis.T
        rest, a, b = _two_shares(r, d)
        shares.append((a, b))
        rest = np.maximum(rest / len(rows), floor[j] ** 2)
        for e, f in itertools.combinations(range(len(screened)), 2):
            part = rest[first[e] : first[e + 1], first[f] : first[f + 1]]
            u, w = np.unravel_index(int(part.argmin()), part.shape)
            left[j, e, f], where[j, e, f] = part[u, w], (first[e] + u, first[f] + w)
    before = np.array([max(float(np.mean(point.residuals[problem.joint_of == j] ** 2)), floor[j] ** 2)
                       if (problem.joint_of == j).any() else 1.0 for j in range(n)])  # fmt: skip
    pairs = []
    for e, f in itertools.combinations(range(len(screened)), 2):
        kinds = (screened[e].kind, screened[f].kind)
        if kinds[0].name in kinds[1].generalises or kinds[1].name in kinds[0].generalises:
            continue
        used = left[:, e, f] > 0
        score = float(np.sum(np.log(before[used] / left[used, e, f])))
        pairs.append((score, e, f))
    pairs.sort(key=lambda pair: -pair[0])
    result = []
    for score, e, f in pairs[:count]:
        start = _start(screened, (e, f), where[:, e, f], first, shares, problem.model)
        result.append(ScreenedPair((screened[e].kind, screened[f].kind), score, start))
    return result


def _two_shares(r: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least sum of squares (K, K) of r (N,) plus shares of two rows of d (K, N) in bounds; the shares (K, K) of each."""
    product, answer = d @ d.T, -(d @ r)
    power = np.diag(product) + 1e-12
    p, q, u, w = power[:, None], power[None, :], answer[:, None], answer[None, :]
    determinant = p * q - product**2
    fine = determinant > 1e-9 * p * q
    determinant = np.where(fine, determinant, 1.0)
    a = np.clip(np.where(fine, (u * q - w * product) / determinant, 0.0), 0.0, MOST)
    b = np.clip(np.where(fine, (w * p - u * product) / determinant, 0.0), 0.0, MOST)
    zero = np.zeros_like(product)
    options = [(a, np.clip((w - product * a) / q, 0.0, MOST)), (np.clip((u - product * b) / p, 0.0, MOST), b),
               (np.clip(u / p, 0.0, MOST) + zero, zero), (zero, np.clip(w / q, 0.0, MOST) + zero)]  # fmt: skip
    total = float(r @ r)
    left = np.stack([total - 2 * (x * u + y * w) + x * x * p + y * y * q + 2 * x * y * product for x, y in options])
    best = left.argmin(axis=0)
    return np.maximum(left.min(axis=0), 0.0), *(np.choose(best, [o[i] for o in options]) for i in (0, 1))


def _start(screened, members, where, first, shares, model: RobotModel) -> dict[ParameterKey, np.ndarray]:
    """Values of both effects: at each joint the size that fits it best there; of an arm, that of its most shared joint."""
    start: dict[ParameterKey, np.ndarray] = {}
    for side, k in enumerate(members):
        item = screened[k]
        size = where[:, side] - first[k]
        share = np.array([shares[j][side][where[j, 0], where[j, 1]] for j in range(model.n)])
        for p in item.kind.parameters:
            group = ParameterKey(p.name, item.kind.name)
            if p.per == "arm":
                most = [
                    max(np.flatnonzero(model.tree.arm == a), key=lambda j: share[j]) for a in range(model.tree.arms)
                ]
                values = np.array([item.sets[group][size[j], a] for a, j in enumerate(most)])
            else:
                values = item.sets[group][size, np.arange(model.n)]
            start[group] = values
    return start


def refit_pair(
    base: RobotModel, pair: ScreenedPair, nominal: Values, hold: str | None, train: Sequence[Recording],
    test: Sequence[Recording], rival: float = np.inf,
) -> Candidate:  # fmt: skip
    """Fit base + two effects from the best sizes of both, at nominal gains (group -> values, empty for base's own)."""
    one, other = pair.kinds
    trial = base.with_effect(one).with_effect(other)
    problem = Problem(trial, train, hold=hold)
    grids = [
        sizes_of(kind, trial, pair.start, LIMITS if _is_limit(kind) else SIZES, both_signs=False) for kind in pair.kinds
    ]
    points = np.array([[start_of(problem, {**nominal, **a, **b}) for b in grids[1]] for a in grids[0]])
    chi2 = problem.joint_rms(problem.residuals(points.reshape(-1, points.shape[2]))) ** 2
    chosen = _chosen(np.log1p(chi2).reshape(*points.shape[:2], -1), [_of_arm(kind) for kind in pair.kinds], trial)
    joint = np.array([row.index if row.key.place in trial.joints else int(np.flatnonzero(trial.tree.arm == row.index)[0])
                      for row in problem.rows])  # fmt: skip
    x = points[chosen[0][joint], chosen[1][joint], np.arange(points.shape[2])]
    fit = minimise(problem, x, ITERATIONS, TOLERANCE, rival=rival)
    model = problem.model_at(fit.x)
    return Candidate(other, model, problem, fit, evaluate(model, test, hold), problem.rollouts)


def _is_limit(kind: type[Effect]) -> bool:
    return any(p.off == p.high for p in kind.parameters)


def _of_arm(kind: type[Effect]) -> bool:
    return all(p.per == "arm" for p in kind.parameters)


def _chosen(cost: np.ndarray, of_arm: Sequence[bool], model: RobotModel) -> tuple[np.ndarray, np.ndarray]:
    """Of each joint the size (n,) of both effects with the least cost (A, B, n); an arm's effect has one size on its joints."""
    first, second = np.zeros(model.n, int), np.zeros(model.n, int)
    for a in range(model.tree.arms):
        own = np.flatnonzero(model.tree.arm == a)
        costs = cost[:, :, own]
        if of_arm[0] and of_arm[1]:
            u, w = np.unravel_index(int(costs.sum(axis=2).argmin()), cost.shape[:2])
            first[own], second[own] = u, w
        elif of_arm[0]:
            first[own] = costs.min(axis=1).sum(axis=1).argmin()
            second[own] = costs[first[own[0]]].argmin(axis=0)
        elif of_arm[1]:
            second[own] = costs.min(axis=0).sum(axis=1).argmin()
            first[own] = costs[:, second[own[0]]].argmin(axis=0)
        else:
            first[own], second[own] = np.unravel_index(costs.reshape(-1, len(own)).argmin(axis=0), cost.shape[:2])
    return first, second
