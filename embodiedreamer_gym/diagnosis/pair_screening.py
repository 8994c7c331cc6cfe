"""Screening of pairs of effects: score all pairs in the linearised model."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.screening import LinearisationPoint, Screened, own_gains
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import ParameterKey, RobotModel

MOST = 1.5  # largest multiple of a simulated change of the residuals for which the linear model is used


@dataclass(frozen=True, eq=False)
class ScreenedPair:
    """Two effects, the fall of the summed log residual with both (linearised), and start values: group -> values."""

    kinds: tuple[type[Effect], type[Effect]]
    score: float
    start: dict[ParameterKey, np.ndarray]


def screen_pairs(
    screened: Sequence[Screened], point: LinearisationPoint, problem: Problem, floor: np.ndarray, count: int
) -> list[ScreenedPair]:
    """The best pairs of screened effects, by the residual that both leave at each joint in the linearised model.

    The joint's own gains are refitted first. Then one size of each effect is applied, times a factor in [0, 1.5]. Pairs
    in which one law contains the other are left out.
    floor (n,): root-mean-square residual, in units of sensor noise, below which a joint has nothing left to explain.
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
        if is_contained(*kinds):
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


def is_contained(one: type[Effect], other: type[Effect]) -> bool:
    """Whether one of two laws is a special case of the other."""
    return one.name in other.generalises or other.name in one.generalises


def _two_shares(r: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least sum of squares (K, K) of r (N,) plus bounded multiples of two rows of d (K, N); the multiples (K, K)."""
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
    """Start values of both effects: the best size of each joint; of an arm, that of the joint with most share."""
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
