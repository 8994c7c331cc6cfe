"""Probabilities of the fitted candidates, and of families of effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.problem import CORRELATED
from embodiedreamer_gym.robot import RobotModel

DRAWS = 400  # bootstrap samples
FAR = 3.0  # median over joints of the chi2 above which samples of one recording count as dependent
HELPED = 0.02  # fall of a joint's log chi2 above which an effect's parameters count there


def candidate_probabilities(
    base: RobotModel, before: tuple[HeldOut, HeldOut], candidates: Sequence[Candidate], seconds: tuple[float, float], recordings: tuple[int, int],
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Probability (K,) of each candidate, given that one of them is right.

    Computed from the likelihoods on the fitted and on the held-out motion, with the penalty of Schwarz's criterion
    (BIC) for the parameters of each effect at the joints that it helps. A joint's noise is the sensor noise, or the
    residual of the best candidate if that is larger. The result is averaged over a Bayesian bootstrap, over blocks of
    time if the errors are near the noise, else over whole recordings, because errors that follow the motion repeat. Its
    weights are never zero: an error that occurs in one block only, such as at a limit that is reached once, is in every
    draw.
    Sources: Schwarz, Ann. Statist. 6(2), 1978; Waddell, Kishino and Ota, Systematic Biology 51(3), 2002 (bootstrap of
    model weights); Rubin, Ann. Statist. 9(1), 1981 (Bayesian bootstrap).

    base: the model without the effects.
    before: its errors, on the fitted and on the held-out motion.
    seconds, recordings: duration and number of recordings of the fitted and of the held-out motion.
    rng: of the bootstrap.
    """
    log_likelihood = np.zeros((len(candidates), 0))
    groups: list[np.ndarray] = []
    far = _is_far([c.held_out for c in candidates])
    for part, errors in enumerate(([c.trained for c in candidates], [c.held_out for c in candidates])):
        blocks = _log_likelihood(errors, seconds[part])
        pieces = len(errors[0].blocks)
        group = np.arange(pieces) // (pieces // recordings[part]) if far else np.arange(pieces)
        groups.append(group + (groups[0].max() + 1 if groups else 0))
        log_likelihood = np.hstack([log_likelihood, blocks])
    penalty = (
        np.array([_parameters(base, before, c) for c in candidates]) * 0.5 * np.log(max(sum(seconds) / CORRELATED, 2.0))
    )
    group = np.concatenate(groups)
    sums = np.stack([log_likelihood[:, group == g].sum(axis=1) for g in range(group.max() + 1)], axis=1)
    weights = sums.shape[1] * rng.dirichlet(np.ones(sums.shape[1]), size=DRAWS)
    drawn = weights @ sums.T - penalty
    odds = np.exp(drawn - drawn.max(axis=1, keepdims=True))
    return np.mean(odds / odds.sum(axis=1, keepdims=True), axis=0)


def _log_likelihood(errors: Sequence[HeldOut], seconds: float) -> np.ndarray:
    """Logarithm of the likelihood (K, pieces) of each candidate's errors."""
    noise = np.maximum(np.min([e.chi2 for e in errors], axis=0), 1.0)
    share = min(1.0, seconds / CORRELATED / max(errors[0].counts.sum(axis=0).max(), 1))
    return np.array([-0.5 * share * np.sum(e.blocks / noise, axis=1) for e in errors])


def _is_far(held: Sequence[HeldOut]) -> bool:
    """Whether the best candidate leaves most joints far above their noise."""
    return bool(np.median(np.min([h.chi2 for h in held], axis=0)) > FAR)


def _parameters(base: RobotModel, before: tuple[HeldOut, HeldOut], candidate: Candidate) -> int:
    """Number of parameters of the added effects, at joints where they lower the error of either motion."""
    after = (candidate.trained, candidate.held_out)
    fall = np.max([np.log(np.maximum(b.chi2, 1.0)) - np.log(np.maximum(a.chi2, 1.0))
                   for b, a in zip(before, after, strict=True)], axis=0)  # fmt: skip
    joints = max(np.count_nonzero(fall > HELPED), 1)
    added = [p for e in candidate.model.effects if not base.has_effect(type(e)) for p in e.parameters]
    return int(sum(joints if p.per == "joint" else candidate.model.tree.arms for p in added))


def family_probabilities(members: Mapping[str, float], catalogue: Mapping[str, type[Effect]]) -> dict[str, float]:
    """Probability of each family of effects, the most likely first; an effect without a family is its own family.

    members: effect -> probability.
    """
    total: dict[str, float] = {}
    for name, probability in members.items():
        family = catalogue[name].family or name
        total[family] = total.get(family, 0.0) + probability
    return dict(sorted(total.items(), key=lambda item: -item[1]))
