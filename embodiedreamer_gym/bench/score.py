"""Scores of answers against the truth: shares with Clopper-Pearson intervals, and held-out errors, by observation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.bench.answers import Answer, read_answers, read_prediction
from embodiedreamer_gym.bench.cases import FORMAT, VISIBLE, rms_error, signal_of
from embodiedreamer_gym.bench.intervals import clopper_pearson, median_interval
from embodiedreamer_gym.errors import EmbodieDreamerError, brief
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.io.results import run_of
from embodiedreamer_gym.io.tables import layout, number
from embodiedreamer_gym.recordings import Recording, load_recordings
from embodiedreamer_gym.standin.labels import PERIODIC, family_of, places

ALL = "all"
ONE = ("single", "subset")
SHARES = {
    "accused": "false alarms: robots without a hidden effect for which an effect is named",
    "name": "one effect: correct name and no other",
    "name_or_tie": "one effect: correct name or a tie with it",
    "family": "one effect: correct family",
    "both": "pairs: both named and no other",
    "unknown": "effects outside the list: verdict unknown",
    "joints": "correctly named: exactly the correct joints",
    "subset_joints": "subset of joints: correct name and joints",
    "held": "95 % intervals that contain the true value",
}
MEDIANS = {
    "to_nominal": "held-out error / that of the nominal model, median",
    "to_noise": "held-out error / sensor noise, median",
}


@dataclass(frozen=True)
class Truth:
    """Ground truth of a case, and its withheld recordings by name; visible: whether these show the hidden effects."""

    tier: str
    observation: str
    effects: Mapping[str, Mapping[str, Mapping[str, float]]]
    nominal: float
    noise: float | None
    withheld: Mapping[str, Recording]
    visible: bool = True


@dataclass(frozen=True)
class Figure:
    """A share or a median of an entry with its interval; of: number of cases or intervals."""

    entry: str
    observation: str
    key: str
    value: float
    low: float
    high: float
    of: int

    def __str__(self) -> str:
        if self.key in MEDIANS:
            return f"{number(self.value)} [{number(self.low, 2)}, {number(self.high, 2)}]"
        return f"{round(self.value * self.of)}/{self.of} [{100 * self.low:.0f}, {100 * self.high:.0f}] %"


@dataclass(frozen=True)
class Scores:
    """All figures; `sha256` of the truth; run: where the answers were computed, as in `run.json`."""

    figures: tuple[Figure, ...]
    entries: tuple[str, ...]
    cases: int
    sha256: str
    notes: tuple[str, ...] = ()
    run: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The scores as JSON."""
        return {"truth_sha256": self.sha256, "cases": self.cases, "notes": list(self.notes),
                "figures": [vars(figure) for figure in self.figures]}  # fmt: skip

    def __str__(self) -> str:
        parts = [f"{self.cases} cases, SHA-256 of the truth {self.sha256}"]
        for observation in dict.fromkeys(figure.observation for figure in self.figures):
            cells = {(f.entry, f.key): str(f) for f in self.figures if f.observation == observation}
            rows = [[text, *(cells.get((entry, key), "-") for entry in self.entries)]
                    for key, text in {**SHARES, **MEDIANS}.items() if any(k == key for _, k in cells)]  # fmt: skip
            parts.append(layout([observation, *self.entries], rows, 34 + 22 * len(self.entries)))
        return "\n\n".join([*parts, *self.notes])


def score(truth: Path, files: Sequence[Path]) -> Scores:
    """Score files of answers; a case that an entry does not answer, or fails to answer, counts as wrong.

    truth: the folder that `make_cases` filled.
    Raises: EmbodieDreamerError in one sentence for a damaged file, an unknown case, or an entry that answers a case in
    two files.
    """
    hidden, digest = read_truth(truth)
    seed = read_json(truth / "truth.json", what="truth").get("seed")
    by_entry: dict[str, dict[str, tuple[Answer, Path]]] = {}
    for file in files:
        for answer in read_answers(file):
            if answer.case not in hidden:
                raise EmbodieDreamerError(
                    f"{file}: case {brief(answer.case)} is not one of the {len(hidden)} cases of {truth}."
                )
            if answer.truth_sha256 not in ("", digest):
                raise EmbodieDreamerError(
                    f"{file}: the answer to case {answer.case} belongs to another set of cases than {truth}."
                )
            given = by_entry.setdefault(answer.entry, {})
            if answer.case in given:
                raise EmbodieDreamerError(
                    f"{file}: entry {brief(answer.entry)} answers case {answer.case} in another file too."
                )
            given[answer.case] = (answer, file.parent)
    if not by_entry:
        raise EmbodieDreamerError(f"{', '.join(map(str, files))}: there is no answer.")
    by_entry = dict(sorted(by_entry.items()))  # the same table, however the answers are spread over files
    figures, notes = [], []
    unseen = [case for case, one in hidden.items() if one.effects and not one.visible]
    if unseen:
        notes.append(
            f"in {len(unseen)} of {len(hidden)} cases, the withheld recordings do not show the hidden effects; these "
            f"cases are excluded from all shares: {', '.join(unseen[:20])}"
        )
    groups = [ALL, *sorted({one.observation for one in hidden.values()})]
    for entry, given in by_entry.items():
        rows = [
            Row.of(truth_, *given.get(case, (Answer(entry, case, failed="no answer"), truth)))
            for case, truth_ in hidden.items()
        ]
        failed = [row.answer.case for row in rows if row.answer.failed]
        if failed:
            notes.append(
                f"{entry}: {len(failed)} of {len(rows)} cases without an answer, counted as wrong: {', '.join(failed[:10])}"
            )
        for group in groups if len(groups) > 2 else [ALL]:
            figures += _figures(entry, group, [row for row in rows if group in (ALL, row.truth.observation)])
    run = run_of(vars(answer) for given in by_entry.values() for answer, _ in given.values())
    return Scores(tuple(figures), tuple(by_entry), len(hidden), digest, tuple(notes), {**run, "seeds": [seed]})


def read_truth(folder: Path) -> tuple[dict[str, Truth], str]:
    """The truth by case, and the SHA-256 of its file.

    Raises: EmbodieDreamerError for a file that is missing, damaged, or of another format.
    """
    path = folder / "truth.json"
    data = read_json(path, what="truth")
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise EmbodieDreamerError(f"truth {path} is not of format {FORMAT}.")
    try:
        rows = {case: _truth(row, folder / "withheld" / case) for case, row in data["cases"].items()}
    except EmbodieDreamerError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise EmbodieDreamerError(f"truth {path} is damaged: {brief(error)}.") from error
    return rows, hashlib.sha256(path.read_bytes()).hexdigest()


def _truth(row: Mapping[str, Any], folder: Path) -> Truth:
    logs = {log.name: log for log in load_recordings(folder)}
    if set(logs) != set(row["withheld_sha256"]):
        raise EmbodieDreamerError(f"{folder} does not hold the recordings {', '.join(row['withheld_sha256'])}.")
    sensor = [one for one in row["sensor_sd"] if one is not None]
    noise = float(np.mean(sensor)) if sensor else None
    visible = row["visibility"] is None or row["visibility"] >= VISIBLE
    effects = {
        str(name): {str(key): {str(at): float(x) for at, x in values.items()} for key, values in parameters.items()}
        for name, parameters in row["effects"].items()
    }
    return Truth(str(row["tier"]), str(row["observation"]), effects, float(row["nominal_rms"]), noise, logs, visible)


@dataclass(frozen=True)
class Row:
    """An answer with the ground truth; error: of its predictions, None if one is missing."""

    truth: Truth
    answer: Answer
    error: float | None

    @staticmethod
    def of(truth: Truth, answer: Answer, folder: Path) -> Row:
        """Read the predictions and compute their error.

        Raises: EmbodieDreamerError for a damaged prediction.
        """
        if not set(truth.withheld) <= set(answer.predictions):
            return Row(truth, answer, None)
        pairs = [
            (read_prediction(folder / answer.predictions[name], log.joints, signal_of(log), log.time), log)
            for name, log in truth.withheld.items()
        ]
        return Row(truth, answer, rms_error(pairs))

    @property
    def right(self) -> bool:
        """Whether exactly the hidden effects are named."""
        return self.answer.verdict == "missing" and set(self.answer.names) == set(self.truth.effects)

    @property
    def tied(self) -> bool:
        """Whether the hidden effects are among those of a declared tie."""
        return self.answer.verdict == "ambiguous" and set(self.truth.effects) <= set(self.answer.names)

    @property
    def right_joints(self) -> bool:
        """Whether each effect is named on exactly the joints (or end effectors) it acts on."""
        joints = {effect.name: effect.joints for effect in self.answer.effects}
        return all(set(joints.get(name) or ()) == set(at) for name, at in places(self.truth.effects).items())

    @property
    def right_family(self) -> bool:
        """Whether all named effects are of the family of the hidden effect."""
        named = {family_of(name) for name in self.answer.names}
        return self.answer.verdict in ("missing", "ambiguous") and named == {
            family_of(name) for name in self.truth.effects
        }

    def held(self) -> Iterable[bool]:
        """For each interval of the hidden effects, on joints where they act: whether it contains the true value."""
        for effect in self.answer.effects:
            for parameter, rows in effect.parameters.items():
                true = self.truth.effects.get(effect.name, {}).get(parameter, {})
                if (effect.name, parameter) not in PERIODIC:
                    yield from (
                        row["low"] <= true[at] <= row["high"] for at, row in rows.items() if at in true and "low" in row
                    )


def _figures(entry: str, group: str, rows: Sequence[Row]) -> list[Figure]:
    """Figures of an entry for its rows; an entry that gives a verdict in no case has no shares."""
    asked: dict[str, tuple[Callable[[Row], bool], tuple[str, ...]]] = {
        "accused": (lambda row: row.answer.verdict in ("missing", "ambiguous") or bool(row.answer.failed), ("none",)),
        "name": (lambda row: row.right, ONE),
        "name_or_tie": (lambda row: row.right or row.tied, ONE),
        "family": (lambda row: row.right_family, ONE),
        "both": (lambda row: row.right, ("pair",)),
        "unknown": (lambda row: row.answer.verdict == "unknown", ("outside",)),
        "subset_joints": (lambda row: row.right and row.right_joints, ("subset",)),
    }
    answers = {
        key: [test(row) for row in rows if row.truth.tier in tiers and (row.truth.visible or key == "accused")]
        for key, (test, tiers) in asked.items()
    }
    answers["joints"] = [row.right_joints for row in rows if row.right and row.truth.effects]
    answers["held"] = [held for row in rows if row.right for held in row.held()]
    naming = any(row.answer.verdict is not None for row in rows)
    found = [
        Figure(entry, group, key, sum(given) / len(given), *clopper_pearson(sum(given), len(given)), len(given))
        for key, given in answers.items() if given and naming
    ]  # fmt: skip
    errors = [(row.error, row.truth) for row in rows if row.error is not None]
    ratios = {"to_nominal": [error / truth.nominal for error, truth in errors],
              "to_noise": [error / truth.noise for error, truth in errors if truth.noise]}  # fmt: skip
    found += [Figure(entry, group, key, float(np.median(given)), *median_interval(given), len(given))
              for key, given in ratios.items() if given]  # fmt: skip
    return found
