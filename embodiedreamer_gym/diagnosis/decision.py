"""Decide between two effects: fit both and compare their likelihoods on held-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate
from embodiedreamer_gym.diagnosis.one_effect import calibrated
from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.phys_aligner.problem import CORRELATED
from embodiedreamer_gym.recordings import Recording, thin
from embodiedreamer_gym.robot import RobotModel

ODDS = 10.0  # odds to one from which the more likely effect is chosen
SURE = 2.0  # standard errors by which the ratio must exceed zero
MAX_SECONDS = 80.0  # s of motion for fitting, and as much for testing


@dataclass(frozen=True)
class LikelihoodRatio:
    """2 x difference of log-likelihood between two fitted models on held-out recordings, and its standard error."""

    value: float
    error: float

    @property
    def decides(self) -> bool:
        """Whether the first model is significantly more likely."""
        return self.value > max(2 * np.log(ODDS), SURE * self.error)


@dataclass(frozen=True, eq=False)
class Decision:
    """Result of a comparison of two effects.

    effects: the more likely one first; best: the chosen effect, None if these recordings do not distinguish the two or
    show neither.
    ratio: of the first effect to the second; over_none: of the first effect to a model without either.
    candidates: the two fits.
    """

    effects: tuple[str, str]
    best: str | None
    ratio: LikelihoodRatio
    over_none: LikelihoodRatio
    candidates: tuple[Candidate, Candidate] = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON."""
        ratios = {"ratio": self.ratio, "over_none": self.over_none}
        return {"effects": list(self.effects), "best": self.best, "unit": "2 x difference of log-likelihood",
                **{name: {"value": r.value, "error": r.error} for name, r in ratios.items()}}  # fmt: skip

    def __str__(self) -> str:
        first, second = self.effects
        answer = f"it is {self.best}" if self.best else f"these recordings do not tell {first} from {second}"
        if not self.over_none.decides:
            answer = f"these recordings show neither {first} nor {second}"
        return f"{first} over {second}: 2 x difference of log-likelihood {self.ratio.value:.3g} +- {self.ratio.error:.2g}; {answer}."


def decide(
    model: RobotModel, effects: tuple[str, str], train: Sequence[Recording], test: Sequence[Recording],
    progress: ProgressCallback | None = None,
) -> Decision:  # fmt: skip
    """Fit a model with each of two effects, and compare the likelihoods of the held-out recordings.

    Of a law and its special case, the special case is chosen unless the richer law is significantly more likely.

    model: without the two effects.
    effects: names of the two.
    train, test: recordings for fitting, and held-out recordings for testing; the motion that distinguishes the two
    should be in both.
    progress: is called as the work advances.
    Raises: CalibrationError or SimulationError if the recordings do not fit the model, EffectError for an unknown
    effect.
    """
    progress = progress_or_silence(progress)
    kinds = [find_effect(name, model.catalogue) for name in effects]
    train, test = thin(train, MAX_SECONDS), thin(test, MAX_SECONDS)
    base = calibrated(model, train, test, progress)
    candidates = []
    for done, kind in enumerate(kinds, 1):
        candidates.append(base.with_effect(kind))
        progress("refitting effects", done, len(kinds), effect=kind.name)
    share = independent_share(test)
    one, other = sorted(candidates, key=lambda c: -likelihood_ratio(c.held_out, candidates[0].held_out, share).value)
    ratio = likelihood_ratio(one.held_out, other.held_out, share)
    over_none = likelihood_ratio(one.held_out, evaluate(base.calibration.model, test), share)
    best = one.kind.name if ratio.decides else None
    if not ratio.decides and other.kind.name in one.kind.generalises:
        best = other.kind.name
    if not ratio.decides and one.kind.name in other.kind.generalises:
        best = one.kind.name
    best = best if over_none.decides else None
    return Decision((one.kind.name, other.kind.name), best, ratio, over_none, (one, other))


def likelihood_ratio(one: HeldOut, other: HeldOut, share: float) -> LikelihoodRatio:
    """2 x difference of log-likelihood, one minus other, on the same held-out recordings.

    share: of the samples that counts as independent. A joint's noise is the sensor noise, or the residual of the better
    model if that is larger. The standard error is that of a sum over pieces of time, within which samples may be
    correlated.
    Source: Vuong, Econometrica 57 (1989), likelihood ratio tests of non-nested models.
    """
    noise = np.maximum(np.minimum(one.chi2, other.chi2), 1.0)
    pieces = share * np.sum((other.blocks - one.blocks) / noise, axis=1)
    return LikelihoodRatio(float(pieces.sum()), float(np.sqrt(len(pieces)) * pieces.std(ddof=1)))


def independent_share(recordings: Sequence[Recording]) -> float:
    """Share of the samples of recordings that counts as independent."""
    samples = sum(len(r.time) for r in recordings)
    return min(1.0, sum(r.duration for r in recordings) / (CORRELATED * samples))
