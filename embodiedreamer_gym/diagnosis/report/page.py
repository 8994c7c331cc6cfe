"""The report: one self-contained HTML page, its pictures inside, readable without JavaScript."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path

from embodiedreamer_gym.diagnosis.compare import Comparison, compare
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.error_breakdown import Where
from embodiedreamer_gym.diagnosis.report import sections
from embodiedreamer_gym.diagnosis.report.words import closer_look, effect_name, headline, verdict_sentence
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel


def write_report(
    folder: str | Path,
    *,
    comparison: Comparison | None = None,
    where: Where | None = None,
    calibration: Calibration | None = None,
    diagnosis: Diagnosis | None = None,
    recordings: Sequence[Recording] = (),
    models: Sequence[RobotModel] = (),
) -> Path:
    """Write index.html into a folder, beside it first, then renamed; returns its path.

    Any of the results may be left out. Without a comparison, `models` (of a diagnosis: its nominal,
    calibrated and better model) are compared on `recordings`, where there are any.
    Raises: EmbodieDreamerError when there is nothing to report or the folder cannot be written to.
    """
    if comparison is None and recordings:
        comparison = _compare(models, recordings, diagnosis)
    if comparison is None and where is not None:
        comparison = where.comparison
    if comparison is None and calibration is None and diagnosis is None:
        raise EmbodieDreamerError("there is nothing to report; give a comparison, a calibration or a diagnosis.")
    text = "\n".join(_page(comparison, where, calibration, diagnosis))
    target = Path(folder) / "index.html"
    part = target.with_name(".index.html.part")
    try:
        target.parent.mkdir(exist_ok=True)
        part.write_text(text, encoding="utf-8")
        os.replace(part, target)
    except OSError as error:
        if part.is_file():
            part.unlink()
        raise EmbodieDreamerError(f"report {folder} cannot be written: {error.strerror or error}.") from error
    return target


def _compare(
    models: Sequence[RobotModel], recordings: Sequence[Recording], diagnosis: Diagnosis | None
) -> Comparison | None:
    if models or diagnosis is None:
        return compare(tuple(models), recordings) if models else None
    found = {"nominal": diagnosis.nominal, "calibrated": diagnosis.calibrated}
    if diagnosis.effects:
        found[f"with {', '.join(map(effect_name, diagnosis.effects))}"] = diagnosis.model
    return compare(tuple(found.values()), recordings, labels=tuple(found))


def _page(
    comparison: Comparison | None,
    where: Where | None,
    calibration: Calibration | None,
    diagnosis: Diagnosis | None,
) -> Iterator[str]:
    given = {"Diagnosis": diagnosis, "Calibration": calibration, "Where the model fails": where}
    kind = next((name for name, part in given.items() if part is not None), "Comparison")
    source = diagnosis or calibration
    model = source.model if source else comparison.models[-1] if comparison else None
    title = escape(model.name if model else "")
    style = (resources.files("embodiedreamer_gym.diagnosis.report") / "style.css").read_text(encoding="utf-8")
    yield "<!DOCTYPE html>"
    yield f'<html lang="en"><head><meta charset="utf-8"><title>{kind}: {title}</title>'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<style>{style}</style></head><body>"
    yield f'<header><p class="kind">{kind}</p><h1>{title}</h1></header><main>'
    yield from _top(comparison, where, calibration, diagnosis)
    if diagnosis:
        yield from sections.staircase(diagnosis.steps, diagnosis.error["noise"] or 0.0, diagnosis.unit, held_out=True)
    elif comparison:
        steps = list(zip(comparison.labels, comparison.error.tolist(), strict=True))
        yield from sections.staircase(steps, comparison.noise, comparison.unit, held_out=False)
    if comparison:
        yield from sections.overlays(comparison)
    if diagnosis:
        yield from sections.ranking(diagnosis.as_dict())
    if comparison:
        yield from sections.heat_map(comparison)
    if where:
        yield from sections.goes_with(where, "calibrated model" if diagnosis else "")
    if comparison:
        yield from sections.joint_table(comparison)
    if source:
        yield from sections.parameters(source.model)
    data = diagnosis.as_dict() if diagnosis else None
    yield from sections.unseen(data, calibration.undetermined if calibration else ())
    if data:
        yield from sections.trust(data)
    yield "</main>"
    if comparison:
        yield from sections.footer(comparison)
    yield "</body></html>"


def _top(
    comparison: Comparison | None,
    where: Where | None,
    calibration: Calibration | None,
    diagnosis: Diagnosis | None,
) -> Iterator[str]:
    """The answer in one sentence, and its main figures."""
    if diagnosis:
        data = diagnosis.as_dict()
        yield f'<p class="verdict">{escape(verdict_sentence(data))}</p>'
        more = closer_look(data, diagnosis.sentence)
        yield f"<p>{escape(more)}</p>" if more else ""
        yield sections.diagnosis_numbers(data)
        return
    cells = sections.comparison_numbers(comparison) if comparison else []
    if calibration:
        cells.append(sections.cost(calibration.rollouts, calibration.seconds))
    yield f'<p class="verdict">{escape(headline(comparison, where, calibration))}</p>'
    yield sections.numbers(cells)
