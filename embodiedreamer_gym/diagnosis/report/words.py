"""The verdict and the main figures of a diagnosis in plain sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from embodiedreamer_gym.diagnosis.tables import number


def effect_name(name: str) -> str:
    """An effect's name for reading."""
    return name.replace("_", " ")


def listed(names: Sequence[str], word: str = "and") -> str:
    """Names as a list in a sentence."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else ""


def on_joints(names: Sequence[str], most: int = 6) -> str:
    """Where an effect is; more joints than can be read are counted."""
    if not names:
        return ""
    if len(names) > most:
        return f" on {len(names)} joints"
    return f" on {listed(list(names))}"


def verdict_sentence(data: Mapping[str, Any]) -> str:
    """One sentence from a diagnosis' JSON."""
    verdict, effects = data["verdict"], list(data["effects"])
    where = {e: on_joints(data["joints"].get(e, [])) for e in effects}
    named = [f"{effect_name(e)}{where[e]}" for e in effects]
    error = data["error"]
    fall = f"the held-out error falls from {_mrad(error['calibrated'])} to {_mrad(error['with_effect'])} mrad"
    floor = f"the sensor noise is {_mrad(error['noise'])} mrad"
    if verdict == "missing":
        return f"The model lacks {listed(named)}: with it {fall} ({floor})."
    if verdict == "ambiguous":
        return f"The model lacks {listed(named, 'or')}: these recordings cannot tell which ({floor})."
    if verdict == "nothing_missing":
        return f"Nothing is missing: calibrated, the model is {_mrad(error['calibrated'])} mrad off, {floor}."
    left = f"{_mrad(error['calibrated'])} mrad remain where {floor}"
    if effects and error["with_effect"] is not None:
        return f"Something is missing that no known effect explains: {left}; closest is {listed(named)}."
    return f"Something is missing that no known effect explains: {left}."


def _mrad(value: float | None) -> str:
    return number(None if value is None else 1e3 * value)
