"""Answers: one JSON object per line, checked field by field; predictions are separate csv files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError, brief
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.recordings.csv_text import check_header, lines_of, open_text, table

VERDICTS = ("nothing_missing", "missing", "ambiguous", "unknown")
FIELDS = ("entry", "case", "verdict", "effects", "predictions", "seconds", "failed", "truth_sha256", "run")
RUN_FIELDS = ("version", "commit", "machine", "date")
EFFECT_FIELDS = ("name", "probability", "joints", "parameters")
MOST_TEXT = 200  # largest number of characters of a name
LARGEST = 1e100  # largest predicted number; its square is finite


@dataclass(frozen=True)
class NamedEffect:
    """An effect that an answer names.

    probability: 0 .. 1, None if the entry gives none. joints: joints or end effectors, None if not stated.
    parameters: parameter -> joint -> {"value": v, "low": l, "high": h}; low and high (95 %) may both be left out.
    """

    name: str
    probability: float | None = None
    joints: tuple[str, ...] | None = None
    parameters: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """Answer of an entry to a case.

    verdict: one of VERDICTS, None for an entry that names nothing. predictions: name of the motion -> csv file,
    relative to the answers' folder. failed: why there is no answer, "" if there is one. truth_sha256: SHA-256 of the
    truth of the set of cases, as in its bench.json, "" if not stated. run: RUN_FIELDS -> text, as far as stated.
    """

    entry: str
    case: str
    verdict: str | None = None
    effects: tuple[NamedEffect, ...] = ()
    predictions: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None
    failed: str = ""
    truth_sha256: str = ""
    run: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)


def read_answers(path: Path) -> list[Answer]:
    """Answers of a file, the last one of each entry and case; a line that another process is still writing is left out.

    Raises: EmbodieDreamerError in one sentence, with file and line, if an answer does not have the form of `Answer`.
    """
    answers: dict[tuple[str, str], Answer] = {}
    try:
        with open_text(path) as file:
            for number, line in enumerate(lines_of(file, path), 1):
                if line.strip() and line.endswith("\n"):
                    answer = parse_answer(line, f"{path}: line {number}")
                    answers[answer.entry, answer.case] = answer
    except RecordingError as error:
        raise EmbodieDreamerError(str(error)) from error
    return list(answers.values())


def parse_answer(line: str, where: str) -> Answer:
    """Parse one answer.

    Raises: EmbodieDreamerError that begins with `where`.
    """
    try:
        data = json.loads(line)
        line.encode()
    except (json.JSONDecodeError, RecursionError, UnicodeError) as error:
        raise EmbodieDreamerError(f"{where} is not a JSON object: {brief(error)}.") from error
    check = _Checks(where)
    check.fields(data, FIELDS, "the answer")
    verdict = data.get("verdict")
    if verdict is not None and verdict not in VERDICTS:
        raise check.error(f"verdict {brief(verdict)} must be null or one of {', '.join(VERDICTS)}")
    effects = tuple(_effect(one, check) for one in check.items(data.get("effects", []), "effects"))
    if verdict in ("missing", "ambiguous") and not effects:
        raise check.error(f'verdict "{verdict}" needs effects')
    if verdict in ("nothing_missing", None) and effects:
        raise check.error(f"verdict {json.dumps(verdict)} must not name effects, but names {len(effects)}")
    if len({one.name for one in effects}) < len(effects):
        raise check.error("an effect is named twice")
    predictions, run = (check.mapping(data.get(name, {}), name) for name in ("predictions", "run"))
    check.fields(run, RUN_FIELDS, "run")
    return Answer(
        entry=check.text(data.get("entry"), "entry"),
        case=check.text(data.get("case"), "case"),
        verdict=verdict,
        effects=effects,
        predictions={name: _file(check.text(file, f"predictions.{name}"), check) for name, file in predictions.items()},
        seconds=check.number(data["seconds"], "seconds", 0.0) if data.get("seconds") is not None else None,
        failed=check.text(data["failed"], "failed", 10_000) if data.get("failed") else "",
        truth_sha256=check.text(data["truth_sha256"], "truth_sha256") if data.get("truth_sha256") else "",
        run={name: check.text(text, f"run.{name}") for name, text in run.items()},
    )


def _effect(data: Any, check: _Checks) -> NamedEffect:
    check.fields(data, EFFECT_FIELDS, "an effect")
    name = check.text(data.get("name"), "effects.name")
    joints, probability = data.get("joints"), data.get("probability")
    parameters = {}
    for parameter, rows in check.mapping(data.get("parameters", {}), f"{name}.parameters").items():
        parameters[parameter] = {}
        for joint, row in check.mapping(rows, f"{name}.{parameter}").items():
            what = f"{name}.{parameter}.{joint}"
            check.fields(row, ("value", "low", "high"), what)
            values = {key: check.number(value, f"{what}.{key}") for key, value in row.items() if value is not None}
            if "value" not in values or ("low" in values) != ("high" in values):
                raise check.error(f"{what} needs value, and either both low and high or neither")
            if values.get("low", 0.0) > values.get("high", math.inf):
                raise check.error(f"{what}.low is above its high")
            parameters[parameter][joint] = values
    return NamedEffect(
        name,
        None if probability is None else check.number(probability, f"{name}.probability", 0.0, 1.0),
        None if joints is None else tuple(check.text(one, f"{name}.joints") for one in check.items(joints, f"{name}.joints")),
        parameters,
    )  # fmt: skip


def _file(text: str, check: _Checks) -> str:
    if Path(text).is_absolute() or ".." in Path(text).parts:
        raise check.error(f"prediction {brief(text)} must be a path below the answers' folder")
    return text


@dataclass(frozen=True)
class _Checks:
    """Checks of JSON values; an error message begins with the position of the value."""

    where: str

    def error(self, what: str) -> EmbodieDreamerError:
        return EmbodieDreamerError(f"{self.where}: {what}.")

    def fields(self, data: Any, allowed: tuple[str, ...], what: str) -> None:
        unknown = [key for key in self.mapping(data, what) if key not in allowed]
        if unknown:
            raise self.error(f"{what} has the field {brief(unknown[0])}; allowed are {', '.join(allowed)}")

    def mapping(self, data: Any, what: str) -> dict[str, Any]:
        if not isinstance(data, dict):
            raise self.error(f"{what} must be a JSON object, not {brief(data)}")
        return data

    def items(self, data: Any, what: str) -> list[Any]:
        if not isinstance(data, list):
            raise self.error(f"{what} must be a JSON list, not {brief(data)}")
        return data

    def text(self, data: Any, what: str, most: int = MOST_TEXT) -> str:
        if not isinstance(data, str) or not 0 < len(data) <= most or not data.isprintable():
            raise self.error(f"{what} must be a text of 1 to {most} printable characters, not {brief(data)}")
        return data

    def number(self, data: Any, what: str, low: float = -1e300, high: float = 1e300) -> float:
        if not isinstance(data, int | float) or isinstance(data, bool) or not low <= data <= high:
            raise self.error(f"{what} must be a number from {low:g} to {high:g}, not {brief(data)}")
        return float(data)


def answer_row(answer: Answer) -> dict[str, Any]:
    """An answer as a dict for JSON; fields at their defaults are left out."""
    data = {key: value for key, value in asdict(answer).items() if value not in (None, "", (), {}) or key == "verdict"}
    for effect in data.get("effects", ()):
        for key in [key for key in EFFECT_FIELDS if effect[key] in (None, {})]:
            del effect[key]
    return data


def answer_line(answer: Answer) -> str:
    """An answer as a line of JSON; see `answer_row`."""
    return json.dumps(answer_row(answer), allow_nan=False) + "\n"


def write_prediction(path: Path, time: np.ndarray, joints: tuple[str, ...], signal: str, values: np.ndarray) -> None:
    """Write a prediction (T, n) of a signal at times (T,) in s as csv."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(["time", *(f"{joint}.{signal}" for joint in joints)])
    with atomic_file(path) as part:
        np.savetxt(part, np.column_stack([time, values]), fmt="%.9g", delimiter=",", header=header, comments="")


def read_prediction(path: Path, joints: tuple[str, ...], signal: str, time: np.ndarray) -> np.ndarray:
    """Prediction (T, n) of a csv file at the times (T,) of a motion; if the file has other times, it is interpolated.

    Raises: EmbodieDreamerError in one sentence for a file that is missing, not of this form, or too short.
    """
    wanted = [f"{joint}.{signal}" for joint in joints]
    try:
        with open_text(path) as file:
            lines: Iterator[str] = lines_of(file, path)
            header = [column.strip() for column in next(csv.reader([next(lines, "")]), [])]
            check_header(header, path)
            lack = [column for column in ("time", *wanted) if column not in header]
            if lack:
                raise EmbodieDreamerError(
                    f"{path}: there is no column {lack[0]}; it needs time,{','.join(wanted)[:200]}."
                )
            values = table(csv.reader(lines), 2, len(header), path, lambda row, _: [float(text) for text in row])
    except (RecordingError, ValueError) as error:
        raise EmbodieDreamerError(str(error) if str(path) in str(error) else f"{path}: {error}.") from error
    own = values[:, header.index("time")]
    if not (np.abs(values) <= LARGEST).all() or len(own) < 2 or (np.diff(own) <= 0).any():
        raise EmbodieDreamerError(f"{path}: a number is not finite or above {LARGEST:g}, or the times do not increase.")
    step = np.median(np.diff(time))
    if own[0] > time[0] + step or own[-1] < time[-1] - step:
        raise EmbodieDreamerError(f"{path}: it covers {own[0]:g} to {own[-1]:g} s, not {time[0]:g} to {time[-1]:g} s.")
    return np.stack([np.interp(time, own, values[:, header.index(column)]) for column in wanted], axis=1)
