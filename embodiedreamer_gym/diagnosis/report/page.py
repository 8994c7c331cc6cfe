"""The report: one self-contained HTML page with embedded figures, readable without JavaScript."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from embodiedreamer_gym.diagnosis.compare import compare
from embodiedreamer_gym.diagnosis.comparison import GUESSED, Comparison
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.error_breakdown import ErrorBreakdown
from embodiedreamer_gym.diagnosis.regimes import REGIMES
from embodiedreamer_gym.diagnosis.report import error_figures, result_figures, sentences
from embodiedreamer_gym.diagnosis.report.drawing import png
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.io.tables import MILLI, milli, number
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

STEPS = {"nominal": "nominal", "calibrated": "calibrated", "with_effect": "with effect", "noise": "sensor noise"}


@renamed_arguments(where="breakdown")
def write_report(
    folder: str | Path,
    *,
    comparison: Comparison | None = None,
    breakdown: ErrorBreakdown | None = None,
    calibration: Calibration | None = None,
    diagnosis: Diagnosis | None = None,
    recordings: Sequence[Recording] = (),
    models: Sequence[RobotModel] = (),
    links: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write index.html into a folder and return its path; an older page is kept if writing fails.

    Any of the results may be left out. Without a comparison, `models` (by default the nominal, calibrated and final
    model of a diagnosis) are compared on `recordings`, if there are any, except for those that the diagnosis was also
    fitted to.
    links: text -> file in the same folder as the page.
    Raises: EmbodieDreamerError if there is nothing to report or the folder cannot be written to.
    """
    if diagnosis:
        recordings = [recording for recording in recordings if recording.name not in diagnosis.learned_from]
    if comparison is None and recordings and (models or diagnosis):
        by_label = dict(diagnosis.models_by_label()) if diagnosis and not models else {}
        comparison = compare(tuple(models) or tuple(by_label.values()), recordings, tuple(by_label) or None)
    if comparison is None and breakdown is not None:
        comparison = breakdown.comparison
    if comparison is None and calibration is None and diagnosis is None:
        raise EmbodieDreamerError("there is nothing to report; give a comparison, a calibration or a diagnosis.")
    target = Path(folder) / "index.html"
    environment = Environment(
        loader=PackageLoader("embodiedreamer_gym.diagnosis.report", "."), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        undefined=StrictUndefined,
    )  # fmt: skip
    environment.filters |= {"png": png, "milli": milli, "number": number, "code": _code,
                            "effect_name": sentences.effect_name, "listed": sentences.listed}  # fmt: skip
    context = _context(comparison, breakdown, calibration, diagnosis) | {"links": links}
    text = environment.get_template("page.html").render(context)
    with atomic_file(target) as part:
        target.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
    return target


def _code(text: str) -> Markup:
    """Escaped text, with the parts between backquotes as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _context(
    comparison: Comparison | None, breakdown: ErrorBreakdown | None, calibration: Calibration | None,
    diagnosis: Diagnosis | None,
) -> dict[str, Any]:  # fmt: skip
    """The values that the page shows."""
    results = {"Diagnosis": diagnosis, "Calibration": calibration, "Error breakdown": breakdown}
    kind = next((name for name, result in results.items() if result is not None), "Comparison")
    source = diagnosis or calibration
    model = source.model if source else comparison.models[-1] if comparison else None
    context: dict[str, Any] = {
        "kind": kind, "title": model.name if model else "", "errors": error_figures, "results": result_figures,
        "comparison": comparison, "breakdown": breakdown, "diagnosis": diagnosis, "next_step": "", "before": 0,
        "verdict": sentences.headline(comparison, breakdown, calibration), "numbers": [], "steps": [], "story": "",
        "ranking": [], "at_fault": (), "worst": [], "breakdown_worst": [], "unexplained": [], "unseen": [], "trust": [],
        "attributed": False, "held_out": False,
        "gains_guessed": ("nominal",) if diagnosis and diagnosis.gains_guessed else (),
    }  # fmt: skip
    if comparison:
        context["steps"] = list(zip(comparison.labels, comparison.error.tolist(), strict=True))
        context |= {"noise": comparison.noise, "unit": comparison.unit}
    if diagnosis:
        context |= _of_diagnosis(diagnosis)
        labels = comparison.labels[:-1] if comparison else ()
        context["before"] = labels.index("calibrated") if "calibrated" in labels else 0
        compared = [r.name for r in comparison.recordings] if comparison else []
        context["held_out"] = not set(compared) & set(diagnosis.learned_from)
    elif comparison:
        cells = zip(comparison.labels, comparison.error, comparison.end_effector_mm, strict=True)
        context["numbers"] = [(label, milli(error, comparison.unit), _at_end(end)) for label, error, end in cells]
        context["numbers"].append(("sensor noise", milli(comparison.noise, comparison.unit), ""))
    if source:
        context["numbers"].append(("cost", f"{source.seconds:.0f} s", f"{source.rollouts} rollouts"))
    if calibration and calibration.undetermined:
        names = ", ".join(calibration.undetermined)
        context["unseen"].append(f"Parameters that this motion does not determine: {names}.")
    if context["steps"]:
        context["story"] = ", then ".join(f"{label} {milli(e, context['unit'])}" for label, e in context["steps"])
        context["milli_unit"] = MILLI[context["unit"]]
    if comparison:
        context |= _of_comparison(comparison, context["before"], context["at_fault"])
    if breakdown:
        context["breakdown_worst"] = error_figures.worst_joints(breakdown.comparison, 0, context["at_fault"])
        context["attributed"] = bool(np.isfinite(breakdown.controller_share).any())
        context["names"] = lambda columns: [breakdown.comparison.joints[j] for j in columns]
    rows = source.model.parameters().rows if source else ()
    context["with_interval"] = [row for row in rows if row.interval]
    context["parameters"] = [
        (r.name, number(r.value, 4), " … ".join(number(v, 4) for v in r.interval) if r.interval else "–", r.unit)
        for r in rows
    ]
    return context


def _of_diagnosis(diagnosis: Diagnosis) -> dict[str, Any]:
    """The values that the page shows of a diagnosis."""
    data, error, guessed = diagnosis.as_dict(), diagnosis.error, diagnosis.gains_guessed
    names = {**STEPS, "nominal": f"nominal ({GUESSED})" if guessed else "nominal"}
    ranking = sorted(
        (r for r in diagnosis.ranking if np.isfinite(r.held_out_chi2)), key=lambda entry: entry.held_out_chi2
    )
    return {
        "verdict": sentences.verdict_sentence(data), "next_step": sentences.next_step(data, diagnosis.sentence),
        "numbers": [
            (name, milli(error[key], diagnosis.unit), _at_end(diagnosis.end_effector_mm.get(key)))
            for key, name in names.items() if error.get(key) is not None
        ],
        "steps": [(names.get(label, label.replace("_", " ")), e) for label, e in diagnosis.steps],
        "noise": error["noise"] or 0.0, "unit": diagnosis.unit, "ranking": ranking,
        "ranking_rows": [
            (sentences.effect_name(r.effect), number(r.held_out_chi2), sentences.with_interval(r.gain, r.gain_error), r.note)
            for r in ranking
        ],
        "at_fault": tuple({joint for joints in diagnosis.joints.values() for joint in joints}),
        "unexplained": [(joint, sentences.percent(share)) for joint, share in diagnosis.unexplained.items()],
        "unseen": sentences.unseen_sentences(data),
        "trust": [*data["notes"], sentences.alarm_sentence(data), sentences.false_alarm_sentence()],
    }  # fmt: skip


def _of_comparison(comparison: Comparison, before: int, at_fault: Sequence[str]) -> dict[str, Any]:
    """The values that the page shows of a comparison, for model `before` and the last one."""

    def label(name: str) -> str:
        return f"{name} ({GUESSED})" if name in comparison.gains_guessed else name

    grid, several = comparison.grid(before), len(comparison.labels) > 1
    row, column = np.unravel_index(int(np.nanargmax(grid)), grid.shape)
    rows = []
    for j, joint in enumerate(comparison.joints):
        rms, noise = comparison.joint_rms[:, j], comparison.joint_noise[j]
        change = f"{100 * (rms[-1] / rms[before] - 1):+.0f} %".replace("-", "−") if rms[before] > 0 else "-"
        rows.append([joint, *(number(1e3 * v) for v in rms), *([change] if several else []), number(1e3 * noise),
                     number(rms[-1] / noise, 2), MILLI[comparison.units[j]]])  # fmt: skip
    usable = comparison.signals.usable
    return {
        "gains_guessed": comparison.gains_guessed, "worst": error_figures.worst_joints(comparison, before, at_fault),
        "worst_regime": f"{comparison.joints[row]}, {('all', *REGIMES)[column]}", "several": several,
        "joint_heads": ["joint", *map(label, comparison.labels), *(["change"] if several else []), "noise", "times noise", "unit"],
        "joint_rows": rows, "seconds": sum(r.duration for r in comparison.recordings),
        "left_out": sum(int((~u).sum()) for u in usable), "total": sum(u.size for u in usable),
        "names": lambda columns: [comparison.joints[j] for j in columns],
    }  # fmt: skip


def _at_end(millimetres: float | None) -> str:
    """The error at the end effector, "" if there is none."""
    return (
        f"{number(millimetres)} mm at the end effector" if millimetres is not None and np.isfinite(millimetres) else ""
    )
