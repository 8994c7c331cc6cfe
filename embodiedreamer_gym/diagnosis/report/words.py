"""The answer of a report in plain sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from embodiedreamer_gym.diagnosis.compare import Comparison
from embodiedreamer_gym.diagnosis.tables import number
from embodiedreamer_gym.diagnosis.where import Where
from embodiedreamer_gym.phys_aligner import Calibration

READABLE = 6  # joints in a sentence


def effect_name(name: str) -> str:
    """An effect's name for reading."""
    return name.replace("_", " ")


def mrad(value: float | None) -> str:
    """An error in rad as a number of mrad."""
    return number(None if value is None else 1e3 * value)


def listed(names: Sequence[str], word: str = "and") -> str:
    """Names as a list in a sentence."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else ""


def on_joints(names: Sequence[str]) -> str:
    """Where an effect acts; joints too many to read are counted."""
    if not names:
        return ""
    return f" on {listed(names)}" if len(names) <= READABLE else f" on {len(names)} joints"


def verdict_sentence(data: Mapping[str, Any]) -> str:
    """One sentence from a diagnosis' JSON."""
    error = data["error"]
    effects = [f"{effect_name(e)}{on_joints(data['joints'].get(e, []))}" for e in data["effects"]]
    floor = f"sensor noise is {mrad(error['noise'])} mrad"
    calibrated = f"{mrad(error['calibrated'])} mrad"
    if data["verdict"] == "missing":
        fall = f"the held-out error falls from {calibrated} to {mrad(error['with_effect'])} mrad"
        return f"The model lacks {listed(effects)}; with it {fall} ({floor})."
    if data["verdict"] == "ambiguous":
        return f"The model lacks {listed(effects, 'or')}; these recordings do not tell which."
    if data["verdict"] == "nothing_missing":
        return f"Nothing is missing that these recordings could show: {calibrated} off, {floor}."
    return f"Something is missing that no known effect explains: {calibrated} off, {floor}."


def headline(comparison: Comparison | None, where: Where | None, calibration: Calibration | None) -> str:
    """One sentence from what there is, the most telling first."""
    if comparison and len(comparison.labels) > 1:
        first, last = mrad(comparison.error[0]), mrad(comparison.error[-1])
        return f"The error goes from {first} to {last} mrad; sensor noise is {mrad(comparison.noise)} mrad."
    if calibration:
        left = f"{mrad(calibration.error)} mrad are left on the recordings it was fitted to"
        return f"Calibrated by {calibration.method}: {left}."
    if comparison is None:
        return ""
    error, noise = comparison.error[0], comparison.noise
    times = f", {number(error / noise, 2)} times the sensor noise" if noise > 0 else ""
    place = f"; {_lower(where.findings[1])}" if where and len(where.findings) > 1 else "."
    return f"The simulation is {mrad(error)} mrad off{times}{place}"


def _lower(sentence: str) -> str:
    return sentence[0].lower() + sentence[1:]
