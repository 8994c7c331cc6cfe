"""The verdict of a diagnosis in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.search_state import SURE, SearchState
from embodiedreamer_gym.diagnosis.verdict import EXACT, is_far_from_noise, total_explainable, total_explained
from embodiedreamer_gym.phys_aligner import Calibration

NEGLIGIBLE = 0.005  # probability below which an effect is not printed


@dataclass(frozen=True, eq=False)
class Attempt:
    """Result of a search.

    verdict: as in a `Diagnosis`.
    calibrated, final: the model's calibration without and with the effects found.
    state: the effects found, and errors on held-out recordings.
    p_value: share of faultless robots that are as bad as the calibrated model.
    explainable: (n, 4), see `explainable_shares`; None if the errors are near the sensors' noise.
    """

    verdict: str
    calibrated: Calibration
    final: Calibration
    state: SearchState
    p_value: float
    explainable: np.ndarray | None = None


def verdict_text(
    attempt: Attempt, effects: Sequence[str], places: Mapping[str, Sequence[str]], family: str | None
) -> str:
    """What is missing and where, or why nothing is named, in one to four sentences.

    effects: the named ones; places: effect -> joints or arms; family: of a tie, if it is probable enough.
    """
    verdict, state = attempt.verdict, attempt.state
    usual = f"p = {attempt.p_value:.3f} for such an error if no effect is missing and masses are 2 % off"
    if verdict == "nothing_missing":
        return f"These recordings show no missing effect ({usual})."
    if verdict == "missing":
        named = "; then ".join(f"{e} on {', '.join(places[e])}" for e in effects)
        left = _what_is_left(state)
        return f"Missing: {named}{f', but {left}' if left else ''}."
    if verdict == "ambiguous":
        sure = certain_effects(effects, state.probabilities, places)
        members = probabilities_text({e: p for e, p in state.probabilities.items() if e in effects and e not in sure})
        options = members or " or ".join(effects)
        if family:
            return f"Missing: an effect of the family {family} ({options}); these recordings do not distinguish them."
        if sure:
            named = "; ".join(f"{e} on {', '.join(places[e])}" for e in sure)
            return f"Missing: {named}; and one of {options}, which these recordings do not distinguish."
        return f"Ambiguous: {' or '.join(effects)}{f' ({members})' if members else ''}; these recordings do not distinguish them."
    if state.closest is None:
        return f"Unknown: the model is wrong ({usual}), but no known effect lowers the error."
    names = " and ".join(places) or state.closest.kind.name
    share = total_explained(state.base, state.held if places else state.closest.held_out, state.start_null.chi2)
    verb = "explain" if len(places) > 1 else "explains"
    text = f"Unknown: the model is wrong ({usual}). The closest, {names}, {verb} {100 * max(share, 0.0):.0f} % of the excess error."
    if attempt.explainable is not None and places:
        most = total_explainable(state.base, state.held, state.start_null.chi2, attempt.explainable[:, -1])
        text += f" Of the excess error, {100 * most:.0f} % is predictable from the signals."
    left = _what_is_left(state) if places else ""
    return f"{text} {left[0].upper()}{left[1:]}." if left else text


def certain_effects(
    effects: Sequence[str], members: Mapping[str, float], places: Mapping[str, Sequence[str]]
) -> list[str]:
    """Tied effects that the final model has and that are probable enough to be named.

    members: effect -> probability; places: of the final model's effects.
    """
    return [e for e in effects if e in places and members.get(e, 0.0) >= SURE]


def _what_is_left(state: SearchState) -> str:
    """A clause on the error that a law that is not exact leaves; "" if it leaves none."""
    if state.is_exact or not state.steps or state.by_effort:
        return ""
    if is_far_from_noise(state.base, state.held, state.start_null.chi2):
        return "the error stays far above the sensors' noise"
    return (f"the law is not exact: the worst joint's squared error is {state.excess:.2g} times the 95 % quantile "
            f"of robots that lack no effect (exact: up to {EXACT})")  # fmt: skip


def probabilities_text(members: Mapping[str, float]) -> str:
    """Effects with their probabilities, the most likely first."""
    ranked = sorted(members.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {p:.2f}" for name, p in ranked if p >= NEGLIGIBLE)


def explainable_text(joint: str, shares: Mapping[str, float]) -> str:
    """How much of a joint's error is predictable, and which signals bring most of it."""
    total, before, gains = max(shares.values(), default=0.0), 0.0, {}
    for name, share in shares.items():
        gains[name], before = share - before, share
    most = max(gains, key=lambda name: gains[name])
    return f"{joint}: {100 * total:.0f} % of the calibrated error is predictable, most of it from the {most}"
