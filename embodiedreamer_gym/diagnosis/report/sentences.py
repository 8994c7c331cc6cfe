"""Sentences of a report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from scipy.special import betaincinv

from embodiedreamer_gym.diagnosis.comparison import Comparison
from embodiedreamer_gym.diagnosis.error_breakdown import ErrorBreakdown
from embodiedreamer_gym.diagnosis.report.result_figures import SPREAD
from embodiedreamer_gym.diagnosis.verdict import ALARM, EXACT, INEXACT
from embodiedreamer_gym.diagnosis.wording import certain_effects, probabilities_text
from embodiedreamer_gym.io.tables import milli, number
from embodiedreamer_gym.phys_aligner import Calibration

READABLE = 6  # joints in a sentence
PERCENT = "\N{NO-BREAK SPACE}%"
# False alarms on faultless simulated robots of two generators, and their number; measured by benchmarks.diagnosis.
FALSE_ALARMS, FAULTLESS = 0, 76


def effect_name(name: str) -> str:
    """An effect's name with spaces."""
    return name.replace("_", " ")


def percent(share: float) -> str:
    """A share as "48 %", with a space that does not break."""
    return f"{100 * share:.0f}{PERCENT}"


def with_interval(value: float, error: float) -> str:
    """A value and its 95 % interval from the standard error, as "3.00 [2.80, 3.20]"."""
    return f"{number(value)} [{number(value - SPREAD * error)}, {number(value + SPREAD * error)}]"


def listed(names: Sequence[str], word: str = "and") -> str:
    """Names as a list in a sentence."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else ""


def on_joints(names: Sequence[str]) -> str:
    """Where an effect acts; if there are too many joints to read, their number."""
    if not names:
        return ""
    return f" on {listed(names)}" if len(names) <= READABLE else f" on {len(names)} joints"


def verdict_sentence(data: Mapping[str, Any]) -> str:
    """The verdict as one sentence, from a diagnosis' JSON."""
    error, unit = data["error"], data["error"]["unit"]
    effects = [f"{effect_name(e)}{on_joints(data['joints'].get(e, []))}" for e in data["effects"]]
    floor = f"sensor noise is {milli(error['noise'], unit)}"
    calibrated = milli(error["calibrated"], unit)
    if data["verdict"] == "missing":
        fall = f"the held-out error falls from {calibrated} to {milli(error['with_effect'], unit)}"
        sentence = f"The model lacks {listed(effects)}; with {'it' if len(effects) == 1 else 'them'} {fall} ({floor})."
        return (
            f"{sentence} Its law is not exact: the error stays above that of robots that lack no effect."
            if _is_inexact(data)
            else sentence
        )
    if data.get("family"):
        members = probabilities_text({effect_name(name): data["members"].get(name, 0.0) for name in data["effects"]})
        return f"The model lacks an effect of the family {effect_name(data['family'])} ({members}); these recordings do not tell which."
    if data["verdict"] == "ambiguous":
        sure = certain_effects(data["effects"], data["members"], data["joints"])
        texts = dict(zip(data["effects"], effects, strict=True))
        named = f"{listed([texts[e] for e in sure])}, and also " if sure else ""
        return f"The model lacks {named}{listed([texts[e] for e in texts if e not in sure], 'or')}; these recordings do not tell which."
    if data["verdict"] == "nothing_missing":
        return f"These recordings show no missing effect: the error is {calibrated}, {floor}."
    return f"An effect is missing, but no known effect explains it: the error is {calibrated}, {floor}."


def _is_inexact(data: Mapping[str, Any]) -> bool:
    """Whether a single named effect leaves a little more error than faultless robots have."""
    return len(data["effects"]) == 1 and EXACT < data.get("excess", 0.0) <= INEXACT


def next_step(data: Mapping[str, Any], sentence: str) -> str:
    """Sentences after a verdict: how much the closest effect explains, how to record a deciding motion; "" for none."""
    said, pair = [sentence] if data["verdict"] == "unknown" else [], data["next_question"]
    if pair:
        them = "them" if data["verdict"] == "ambiguous" else listed([effect_name(name) for name in pair])
        said.append(f"A motion that distinguishes {them}: embodiedreamer excite --separate {','.join(pair)}")
    return " ".join(said)


def alarm_sentence(data: Mapping[str, Any]) -> str:
    """The probability that a faultless robot has an error as large as this one."""
    chance = f"of {data['p_value']:.3f}" if data["p_value"] >= 5e-4 else "below 0.001"
    return (
        f"If the model lacked no effect and its masses were 2{PERCENT} off, an error as large as this would have a probability "
        f"{chance}; the model counts as wrong below {ALARM:g}."
    )


def false_alarm_sentence(alarms: int = FALSE_ALARMS, robots: int = FAULTLESS) -> str:
    """How often this procedure names an effect on a faultless robot, with the upper end of its 95 % interval.

    Source: Clopper and Pearson 1934, the exact interval of a binomial share.
    """
    most = 1.0 if alarms == robots else float(betaincinv(alarms + 1, robots - alarms, 0.975))
    return (
        f"For {robots} simulated robots that lack no effect, this procedure named a missing effect for {alarms} "
        f"(95{PERCENT} interval: at most {math.ceil(100 * most - 1e-9)}{PERCENT}); `make bench-diagnosis` measures it again."
    )


def unseen_sentences(data: Mapping[str, Any]) -> list[str]:
    """Which effects these recordings cannot show."""
    if data["unobservable"]:
        names = ", ".join(map(effect_name, data["unobservable"]))
        return [f"Effects that these recordings cannot show: {names}."]
    if data["ranking"]:
        return ["None of the catalogue: each effect of a typical size would be visible in these recordings."]
    return ["Not examined: no effect was tried on these recordings, because nothing is missing."]


def headline(comparison: Comparison | None, breakdown: ErrorBreakdown | None, calibration: Calibration | None) -> str:
    """Return one sentence about the results that were given."""
    if comparison and len(comparison.labels) > 1:
        first, last, floor = (milli(v, comparison.unit) for v in (*comparison.error[[0, -1]], comparison.noise))
        return f"The error goes from {first} to {last}; sensor noise is {floor}."
    if calibration:
        left = f"an error of {milli(calibration.error, calibration.unit)} is left on the fitted recordings"
        return f"Calibrated by {calibration.method}: {left}."
    if comparison is None:
        return ""
    error, noise = comparison.error[0], comparison.noise
    times = f", {number(error / noise, 2)} times the sensor noise" if noise > 0 else ""
    place = f"; {_lower(breakdown.findings[1])}" if breakdown and len(breakdown.findings) > 1 else "."
    return f"The simulation is {milli(error, comparison.unit)} off{times}{place}"


def _lower(sentence: str) -> str:
    return sentence[0].lower() + sentence[1:]
