"""The report: one self-contained HTML page, its pictures inside, readable without JavaScript."""

from __future__ import annotations

import base64
import io
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from embodiedreamer_gym.diagnosis.compare import Comparison, compare
from embodiedreamer_gym.diagnosis.report import figures
from embodiedreamer_gym.diagnosis.report.words import effect_name, on_joints, verdict_sentence
from embodiedreamer_gym.diagnosis.tables import MILLI, number
from embodiedreamer_gym.diagnosis.where import Where
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterRow, RobotModel

RESOLUTION = 150  # dots per inch: sharp on a screen of twice the usual density


class DiagnosisLike(Protocol):
    """What the report reads of a diagnosis."""

    @property
    def model(self) -> RobotModel: ...  # noqa: D102
    @property
    def steps(self) -> Sequence[tuple[str, float]]: ...  # noqa: D102
    @property
    def unexplained(self) -> Mapping[str, float]: ...  # noqa: D102
    def as_dict(self) -> dict[str, Any]: ...  # noqa: D102


def write_report(
    folder: str | Path,
    *,
    comparison: Comparison | None = None,
    where: Where | None = None,
    calibration: Calibration | None = None,
    diagnosis: DiagnosisLike | None = None,
    recordings: Sequence[Recording] = (),
    models: Sequence[RobotModel] = (),
) -> Path:
    """Write index.html into a folder, beside it first, then renamed; returns its path.

    Any of the results may be left out; without a comparison, `models` are compared on `recordings` where both
    are given. Raises: EmbodieDreamerError when there is nothing to report or the folder cannot be written to.
    """
    if comparison is None and where is not None:
        comparison = where.comparison
    if comparison is None and recordings and models:
        comparison = compare(tuple(models), recordings)
    if comparison is None and calibration is None and diagnosis is None:
        raise EmbodieDreamerError(
            "there is nothing to report; give a comparison, a calibration or a diagnosis."
        )
    text = "\n".join(_page(comparison, where, calibration, diagnosis))
    target = Path(folder) / "index.html"
    part = target.with_name(".index.html.part")
    try:
        target.parent.mkdir(exist_ok=True)
        part.write_text(text, encoding="utf-8")
        os.replace(part, target)
    except OSError as error:
        part.unlink(missing_ok=True) if part.parent.is_dir() else None
        raise EmbodieDreamerError(f"report {folder} cannot be written: {error.strerror or error}.") from error
    return target


def _page(
    comparison: Comparison | None,
    where: Where | None,
    calibration: Calibration | None,
    diagnosis: DiagnosisLike | None,
) -> Iterator[str]:
    kind = (
        "Diagnosis"
        if diagnosis
        else "Calibration"
        if calibration
        else "Where it fails"
        if where
        else "Comparison"
    )
    models = [part.model for part in (diagnosis, calibration) if part is not None]
    name = models[0] if models else comparison.models[0] if comparison else None
    title = name.name if name else ""
    style = (resources.files(__package__) / "style.css").read_text(encoding="utf-8")
    yield "<!DOCTYPE html>"
    yield f'<html lang="en"><head><meta charset="utf-8"><title>{kind}: {escape(title)}</title>'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<style>{style}</style></head><body>"
    yield f'<header><p class="kind">{kind}</p><h1>{escape(title)}</h1></header><main>'
    yield f'<p class="verdict">{escape(_headline(comparison, where, calibration, diagnosis))}</p>'
    data = diagnosis.as_dict() if diagnosis else None
    yield from _numbers(comparison, calibration, data)
    if diagnosis and data:
        yield from _staircase(list(diagnosis.steps), data["error"]["noise"])
    elif comparison and len(comparison.labels) > 1:
        yield from _staircase(
            list(zip(comparison.labels, comparison.error.tolist(), strict=True)), comparison.noise
        )
    if comparison:
        yield from _overlays(comparison)
    if data:
        yield from _ranking(data)
    if comparison:
        yield from _heat_map(comparison)
    if where:
        yield from _where(where)
    if comparison:
        yield from _joint_table(comparison)
    if models:
        yield from _parameters(models[0])
    yield from _unseen(calibration, diagnosis, data)
    yield "</main>"
    yield from _footer(comparison)
    yield "</body></html>"


def _headline(comparison, where, calibration, diagnosis) -> str:
    if diagnosis:
        return verdict_sentence(diagnosis.as_dict())
    if calibration:
        return (f"Calibrated by {calibration.method}: {number(1e3 * calibration.error)} mrad on the recordings it was "
                f"fitted to, after {calibration.rollouts} rollouts.")  # fmt: skip
    if where:
        return where.findings[0]
    error, noise = comparison.error, comparison.noise
    if len(error) > 1:
        return (f"The error goes from {number(1e3 * error[0])} to {number(1e3 * error[-1])} mrad; "
                f"the sensor noise is {number(1e3 * noise)} mrad.")  # fmt: skip
    ratio = f"{number(error[0] / noise, 2)} times the sensor noise" if noise > 0 else "without sensor noise"
    return f"The simulation is {number(1e3 * error[0])} mrad off, {ratio}."


def _numbers(
    comparison: Comparison | None, calibration: Calibration | None, data: dict | None
) -> Iterator[str]:
    """The main figures in a line."""
    cells: list[tuple[str, str]] = []
    if data:
        names = {
            "nominal": "nominal",
            "calibrated": "calibrated",
            "with_effect": "with effect",
            "noise": "noise",
        }
        cells += [(name, f"{number(1e3 * data['error'][key])} mrad") for key, name in names.items()
                  if data["error"].get(key) is not None]  # fmt: skip
        ends = data.get("end_effector_mm") or {}
        cells += [(f"end effector, {name}", f"{number(ends[key])} mm") for key, name in names.items()
                  if ends.get(key) is not None and key != "noise"]  # fmt: skip
        cells.append(("cost", f"{data['rollouts']} rollouts, {data['seconds']:.0f} s"))
    elif comparison:
        for label, error, end in zip(
            comparison.labels, comparison.error, comparison.end_effector_mm, strict=True
        ):
            more = f", {number(end)} mm at the end effector" if np.isfinite(end) else ""
            cells.append((label, f"{number(1e3 * error)} mrad{more}"))
        cells.append(("sensor noise", f"{number(1e3 * comparison.noise)} mrad"))
    if calibration and not data:
        cells.append(("cost", f"{calibration.rollouts} rollouts, {calibration.seconds:.0f} s"))
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in cells)
    yield f'<dl class="numbers">{items}</dl>'


def _staircase(steps: list[tuple[str, float]], noise: float) -> Iterator[str]:
    if not steps:
        return
    yield "<h2>How far the error falls</h2>"
    story = ", then ".join(f"{label} {number(1e3 * error)} mrad" for label, error in steps)
    yield picture(figures.staircase(steps, noise), f"Error step by step: {story}; noise {number(1e3 * noise)} mrad.",
                  "Mean over joints of each joint's root-mean-square error, down to what the sensors allow.")  # fmt: skip


def _overlays(comparison: Comparison) -> Iterator[str]:
    joints = figures.worst_joints(comparison)
    if not joints:
        return
    names = ", ".join(comparison.joints[j] for j in joints)
    yield "<h2>Measured and simulated</h2>"
    yield picture(figures.overlay(comparison, joints), f"Motion and error of {names}, measured against simulated.",
                  "The joints with the largest error, at their worst. Left the motion, right measured minus simulated; "
                  "the grey band is what sensor noise alone would give.")  # fmt: skip


def _ranking(data: Mapping[str, Any]) -> Iterator[str]:
    entries = [e for e in data["ranking"] if e.get("held_out_chi2") is not None]
    if not entries:
        return
    best = min(entries, key=lambda e: e["held_out_chi2"])
    yield "<h2>Effects tried</h2>"
    yield picture(figures.ranking(entries, data["effects"]),
                  f"Effects by held-out error, best {effect_name(best['effect'])} with chi2/n "
                  f"{number(best['held_out_chi2'])}.",
                  "Each was added, the model refitted, and judged on recordings that the fit had not seen. "
                  "Blue: named by the verdict.")  # fmt: skip


def _heat_map(comparison: Comparison) -> Iterator[str]:
    grid = comparison.grid()
    row, column = np.unravel_index(int(np.nanargmax(grid)), grid.shape)
    regime = ("all", *figures.REGIMES)[column]
    yield "<h2>Which joint, when</h2>"
    yield picture(figures.heat_map(comparison), f"Joints by regime; the worst is {comparison.joints[row]}, {regime}.",
                  "Mean square error in units of the sensor noise; 1 is as good as can be measured, empty is never "
                  "visited.")  # fmt: skip


def _where(where: Where) -> Iterator[str]:
    yield "<h2>What the error goes with</h2>"
    yield "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in where.findings) + "</ul>"
    joints = figures.worst_joints(where.comparison)
    if joints:
        names = ", ".join(where.comparison.joints[j] for j in joints)
        yield picture(figures.profiles(where, joints), f"Error of {names} against speed, angle, torque and time.",
                      "Error (measured minus simulated): median and middle 68 %.")  # fmt: skip
    if np.isfinite(where.controller_share).any():
        yield picture(figures.sides(where), "Shares of controller and plant side in the unexplained effort, by joint.",
                      "Whether the measured effort departs from what the command asks for, or the motion from what the "
                      "effort gives.")  # fmt: skip


def _joint_table(comparison: Comparison) -> Iterator[str]:
    yield "<h2>Joint by joint</h2>"
    heads = ["joint", *comparison.labels, "noise", "unit"]
    rows = []
    for j, joint in enumerate(comparison.joints):
        errors = [number(1e3 * v) for v in (*comparison.joint_rms[:, j], comparison.joint_noise[j])]
        rows.append([joint, *errors, MILLI[comparison.units[j]]])
    yield "<p>Root-mean-square position error over all usable samples.</p>" + table(heads, rows)


def _parameters(model: RobotModel) -> Iterator[str]:
    rows: tuple[ParameterRow, ...] = model.parameters().rows
    known = [r for r in rows if r.interval]
    yield "<h2>Parameters</h2>"
    if known:
        yield picture(figures.forest(known), f"Values and 95 % intervals of {len(known)} parameters.",
                      "Values with their 95 % intervals; a dashed line marks where an effect would vanish.")  # fmt: skip
    cells = [[r.name, number(r.value, 4), f"{number(r.interval[0], 4)} … {number(r.interval[1], 4)}" if r.interval
              else "–", r.unit] for r in rows]  # fmt: skip
    yield f"<details><summary>All {len(rows)} parameters</summary>"
    yield table(["parameter", "value", "95 % interval", "unit"], cells) + "</details>"


def _unseen(calibration, diagnosis: DiagnosisLike | None, data: dict | None) -> Iterator[str]:
    sentences: list[str] = []
    if diagnosis and data:
        for effect in data["effects"]:
            sentences.append(f"{effect_name(effect)}{on_joints(data['joints'].get(effect, []), 20)}: found.")
        sentences += [_unobservable(entry) for entry in data["unobservable"]]
        for joint, share in diagnosis.unexplained.items():
            sentences.append(f"{joint}: {share:.0%} of its error stays unexplained.")
    if calibration and calibration.undetermined:
        sentences.append("This motion does not determine " + ", ".join(calibration.undetermined) + ".")
    if sentences:
        yield "<h2>What these recordings cannot show</h2>"
        yield "<ul>" + "".join(f"<li>{escape(s)}</li>" for s in sentences) + "</ul>"


def _unobservable(entry: Any) -> str:
    return f"{effect_name(entry)} could be there unseen." if isinstance(entry, str) else str(entry)


def _footer(comparison: Comparison | None) -> Iterator[str]:
    if comparison is None:
        return
    seconds = sum(r.duration for r in comparison.recordings)
    left_out = sum(int((~r.usable).sum()) for r in comparison.recordings)
    total = sum(r.usable.size for r in comparison.recordings)
    names = ", ".join(r.name for r in comparison.recordings)
    yield (f"<footer><p>{len(comparison.recordings)} recordings, {seconds:.1f} s; {left_out} of {total} samples left "
           f"out as contact or faulty. {escape(names)}</p></footer>")  # fmt: skip


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML table of plain texts."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def picture(figure: Figure, alt: str, caption: str) -> str:
    """HTML figure with the picture inside as PNG."""
    data = io.BytesIO()
    FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in a script that the font lacks
        figure.savefig(data, format="png", dpi=RESOLUTION)
    code = base64.b64encode(data.getvalue()).decode("ascii")
    image = f'<img alt="{escape(alt)}" src="data:image/png;base64,{code}">'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"
