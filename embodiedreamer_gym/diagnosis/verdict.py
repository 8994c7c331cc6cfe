"""Rules for the four verdicts on refitted candidates: nothing missing, missing, ambiguous, unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import HeldOut, gain
from embodiedreamer_gym.effects import Effect

VERDICTS = ("nothing_missing", "missing", "ambiguous", "unknown")
ALARM = 0.01  # p-value below which a model is called wrong
SMALLEST_GAIN = 0.1  # fall of the summed log chi2 that an effect must bring to be worth naming
SURE = 2.5  # standard errors by which the gain must exceed zero
TIE = 0.1  # difference of scores below which two effects tie
RICHER = 0.05  # share of the whole gain that a richer law must bring beyond its special case
EXPLAINED = 0.5  # share of the excess error that the effects together must explain, else "unknown"
EXACT = 1.3  # multiple of the 95 % quantile of faultless robots up to which effects leave nothing to explain
INEXACT = 2.0  # the same, up to which a single effect is named although its law is not exact
JUDGEABLE = 10.0  # chi2 of faultless robots above which effects are judged with nuisance parameters
USUAL = 1.25  # multiple of the 95 % quantile of the chi2 of faultless robots up to which nothing is left to explain
FAR = 3.0  # the same, above which a joint is far from its noise
BEYOND_NOISE = 2.0  # the same, in the median over joints, above which no law explains a log down to its noise
NEARLY = 0.95  # share of the excess mean square of all joints; if effects explain more, the rest does not count
MOSTLY = 0.8  # the same for the excess error in logarithms


def improves(before: HeldOut, after: HeldOut, most: np.ndarray | None = None) -> bool:
    """Whether an effect lowers the score by enough to name it, and significantly.

    If the error occurs in one piece of time only, such as at a limit that is reached once, its standard error is as
    large as itself. Then an effect improves if the error was clearly above that of faultless robots and is at most a
    little above it with the effect; most (n,): the chi2 of all but 5 % of faultless robots.
    """
    fall, error = gain(before, after)
    leaves_little = most is not None and bool((after.chi2 / most).max() <= INEXACT < (before.chi2 / most).max())
    return fall > SMALLEST_GAIN and (fall > SURE * error or leaves_little)


def explains_most(before: HeldOut, after: HeldOut, null: np.ndarray) -> bool:
    """Whether a further effect explains most of the excess error that is left."""
    return total_explained(before, after, null) >= EXPLAINED


def contenders(before: HeldOut, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates whose held-out error does not differ from that of the best; the preferred one comes first.

    A special case is preferred to the richer law that contains it, unless the richer law adds a considerable share to
    the total fall from `before`.
    """
    ranked = sorted(candidates, key=lambda c: c.held_out.score)
    best = ranked[0]
    close = [c for c in ranked if not _worse(before, best, c)]
    names = {c.kind.name for c in close}
    plain = [c for c in close if not names.intersection(c.kind.generalises)]
    return plain or close


def brings_little(before: HeldOut, special_case: HeldOut, richer: HeldOut, share: float = RICHER) -> bool:
    """Whether a richer law, or a further effect, lowers the score by only a small share of the total fall."""
    return special_case.score - richer.score <= share * (before.score - richer.score)


def rank_notes(
    ranked: Sequence[str], gains: Sequence[float], effects: Sequence[str],
    catalogue: Mapping[str, type[Effect]],
) -> list[str]:  # fmt: skip
    """Why each effect that ranks before the named ones is not named, "" for the others.

    ranked: effects, best held-out error first; gains: their falls of the score; effects: those that the verdict names.
    """
    first = next((k for k, name in enumerate(ranked) if name in effects), 0)
    notes = [""] * len(ranked)
    for k in range(first):
        special_cases = catalogue[ranked[k]].generalises
        simple = next((name for name in ranked[first:] if name in effects and name in special_cases), None)
        if simple:
            more = gains[k] - gains[ranked.index(simple)]
            notes[k] = f"contains {simple} as a special case and lowers the score by only {more:.2f} more"
        elif len(effects) > 1:
            notes[k] = f"ranks before {ranked[first]} alone, but not together with the other effects"
        else:
            notes[k] = f"ties with {ranked[first]} on held-out motion, and fits the training motion worse"
    return notes


def _worse(before: HeldOut, best: Candidate, other: Candidate) -> bool:
    """Whether a candidate is worse than the best on held-out motion, or slightly worse there and worse in training."""
    fall, error = gain(other.held_out, best.held_out)
    least = max(TIE, 2.0 * error)
    if other.kind.name in best.kind.generalises:  # the richer law always fits the training motion better
        return fall > least and not brings_little(before, other.held_out, best.held_out)
    if fall > least:
        return True
    return fall > 0.0 and other.trained_score - best.trained_score > 3.0 * TIE


def is_convincing(before: HeldOut, after: HeldOut, null: np.ndarray, explainable: np.ndarray | None = None) -> bool:
    """Whether the effects explain the excess error so well that they, and not similar ones, are what is missing.

    The right effects leave no more error than faultless robots have, or little more and nearly nothing of the former
    excess. If no joint comes near its noise, the sensors are more accurate than such models anyway, and effects that
    explain most of the excess are enough. This also holds if some joints are nearer to their noise but none reaches it,
    as long as the effects would be enough with larger errors there. Effects are also enough if they explain nearly all
    that a general regression explains and the regression leaves most joints far from their noise (explainable (n,): the
    chi2 that it leaves, see `explainable_chi2`).
    """
    if total_explained(before, after, null) < EXPLAINED:
        return False
    usual, most = np.quantile(null, (0.5, 0.95), axis=0)
    beyond = after.chi2 / most
    if beyond.max() <= USUAL:
        return True
    far = is_far_from_noise(before, after, null)
    if beyond.min() > FAR:
        return far
    if explainable is None and far:
        return True
    if explainable is not None and np.median(explainable / most) > BEYOND_NOISE:
        return share_of_explainable(before, after, null, explainable) >= MOSTLY
    was, rest = (np.maximum(h.chi2 - usual, 0.0).sum() for h in (before, after))
    was_log, rest_log = (np.log(np.maximum(h.chi2 / usual, 1.0)).sum() for h in (before, after))
    return bool(beyond.max() <= FAR and rest <= (1 - NEARLY) * was and rest_log <= (1 - MOSTLY) * was_log)


def is_far_from_noise(before: HeldOut, after: HeldOut, null: np.ndarray) -> bool:
    """Whether effects explain most of the excess and no joint comes near its noise: sensors resolve more than laws.

    Effects that are convincing at a larger error are convincing at a smaller one, so joints that are nearer to their
    noise count as three times faultless robots.
    """
    usual, most = np.quantile(null, (0.5, 0.95), axis=0)
    if total_explained(before, after, null) < EXPLAINED or (after.chi2 / most).min() <= USUAL:
        return False
    was, rest = (np.maximum(h - usual, 0.0).sum() for h in (before.chi2, np.maximum(after.chi2, FAR * most)))
    return bool(rest <= (1 - EXPLAINED) * was)


def share_of_explainable(before: HeldOut, after: HeldOut, null: np.ndarray, explainable: np.ndarray) -> float:
    """Fall of the log chi2 by the effects, relative to that by the effects or a general regression.

    At each joint, the larger fall of the two counts in the denominator.
    """
    usual = np.median(null, axis=0)
    was, rest = np.maximum(before.chi2, usual), np.maximum(after.chi2, usual)
    least = np.minimum(rest, np.maximum(explainable, usual))
    most = float(np.sum(np.log(was / least)))
    return float(np.sum(np.log(was / rest))) / most if most > 0 else 0.0


def leaves_excess(held: HeldOut, null: np.ndarray) -> bool:
    """Whether some joint's error is larger than the right effects would leave."""
    return bool((held.chi2 / np.quantile(null, 0.95, axis=0)).max() > USUAL)


def unrefuted(candidates: Sequence[Candidate], null: np.ndarray) -> list[Candidate]:
    """Candidates that leave no joint's error above its noise; all of them, if none does.

    The noise of an effort grows with the model's inertia. A model whose error is smaller but above its own noise is
    still rejected.
    """
    exact = [c for c in candidates if not leaves_excess(c.held_out, null)]
    return exact or list(candidates)


def explained(before: HeldOut, after: HeldOut, null: np.ndarray) -> np.ndarray:
    """Share (n,) of each joint's excess mean square that is explained; NaN where there was no excess.

    null (draws, n): chi2 of faultless robots.
    """
    usual, most = np.median(null, axis=0), np.quantile(null, 0.95, axis=0)
    excess = before.chi2 - usual
    share = np.clip((before.chi2 - after.chi2) / np.maximum(excess, 1e-12), -1.0, 1.0)
    return np.where(before.chi2 > most, share, np.nan)


def total_explained(before: HeldOut, after: HeldOut, null: np.ndarray) -> float:
    """Share of the excess error that is explained, over the joints that had any, weighted by their log chi2."""
    share, weight = _weighted(before, after, null)
    return float(weight @ share / weight.sum()) if weight.any() else 0.0


def total_explainable(before: HeldOut, after: HeldOut, null: np.ndarray, ceiling: np.ndarray) -> float:
    """Weighted share of the excess error that the effects explain or a general regression predicts, the larger one.

    ceiling (n,): share of each joint's mean square error that is predictable, see `explainable_shares`.
    """
    share, weight = _weighted(before, after, null)
    return float(weight @ np.maximum(share, ceiling) / weight.sum()) if weight.any() else 0.0


def _weighted(before: HeldOut, after: HeldOut, null: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share (n,) of each joint's excess that is explained, and the joints' weights; both zero where there was none."""
    share = explained(before, after, null)
    weight = np.log(np.maximum(before.chi2 / np.median(null, axis=0), 1.0 + 1e-9))
    return np.nan_to_num(share), np.where(np.isfinite(share), weight, 0.0)
