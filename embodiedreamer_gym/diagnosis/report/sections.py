"""The sections of the report, one function each: results in, HTML out."""

from __future__ import annotations

import base64
import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from embodiedreamer_gym.diagnosis.compare import Comparison
from embodiedreamer_gym.diagnosis.error_breakdown import Where
from embodiedreamer_gym.diagnosis.regimes import REGIMES
from embodiedreamer_gym.diagnosis.report import figures
from embodiedreamer_gym.diagnosis.report.words import (
    alarm_sentence,
    effect_name,
    false_alarm_sentence,
    percent,
    unseen_sentences,
)
from embodiedreamer_gym.io.tables import MILLI, milli, number
from embodiedreamer_gym.robot import RobotModel

RESOLUTION = 150  # dots per inch: sharp on a screen of twice the usual density
STEPS = {"nominal": "nominal", "calibrated": "calibrated", "with_effect": "with effect", "noise": "sensor noise"}


def picture(figure: Figure, alt: str, caption: str) -> str:
    """HTML figure with the picture inside as PNG."""
    data = io.BytesIO()
    FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in a script that the font lacks
        figure.savefig(data, format="png", dpi=RESOLUTION)
    code = base64.b64encode(data.getvalue()).decode("ascii")
    image = f'<div class="scroll"><img alt="{escape(alt)}" src="data:image/png;base64,{code}"></div>'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML table of plain texts."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def bullets(sentences: Sequence[str]) -> str:
    """HTML list of plain texts; what stands between backquotes is code."""
    items = (re.sub("`([^`]+)`", r"<code>\1</code>", escape(s)) for s in sentences)
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"


def numbers(cells: Sequence[tuple[str, str, str]]) -> str:
    """Main figures in a line, each under its name and over a detail."""
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd><dd>{escape(detail)}</dd></div>"
        for name, value, detail in cells
    )
    return f'<dl class="numbers">{items}</dl>'


def diagnosis_numbers(data: Mapping[str, Any]) -> str:
    """Errors in joint units and at the end effector, from a diagnosis' JSON."""
    ends, error = data.get("end_effector_mm") or {}, data["error"]
    cells = [
        (name, milli(error[key], error["unit"]), _at_end(ends.get(key)))
        for key, name in STEPS.items()
        if error.get(key) is not None
    ]
    return numbers([*cells, cost(data["rollouts"], data["seconds"])])


def _at_end(millimetres: float | None) -> str:
    """The error at the end effector, where there is one."""
    known = millimetres is not None and np.isfinite(millimetres)
    return f"{number(millimetres)} mm at the end effector" if known else ""


def comparison_numbers(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Each model's errors, and the noise."""
    found = zip(comparison.labels, comparison.error, comparison.end_effector_mm, strict=True)
    cells = [(label, milli(error, comparison.unit), _at_end(end)) for label, error, end in found]
    return [*cells, ("sensor noise", milli(comparison.noise, comparison.unit), "")]


def cost(rollouts: int, seconds: float) -> tuple[str, str, str]:
    """What the answer has cost."""
    return "cost", f"{seconds:.0f} s", f"{rollouts} rollouts"


def staircase(steps: Sequence[tuple[str, float]], noise: float, unit: str, held_out: bool) -> Iterator[str]:
    """The error falling from step to step."""
    if len(steps) > 1:
        steps = [(effect_name(label) if label.startswith("+ ") else label, error) for label, error in steps]
        story = ", then ".join(f"{label} {milli(error, unit)}" for label, error in steps)
        seen = "on recordings that no fit has seen, " if held_out else ""
        yield "<h2>How far the error falls</h2>"
        yield picture(
            figures.staircase(steps, noise, MILLI[unit]),
            f"Error step by step: {story}; sensor noise {milli(noise, unit)}.",
            f"Mean over joints of each joint's root-mean-square error, {seen}down to what the sensors allow.",
        )


def overlays(comparison: Comparison) -> Iterator[str]:
    """Measured and simulated motion of the worst joints."""
    joints = figures.worst_joints(comparison)
    if joints:
        names = ", ".join(comparison.joints[j] for j in joints)
        yield "<h2>Measured and simulated</h2>"
        yield picture(
            figures.overlay(comparison, joints),
            f"The {_subject(comparison)} of {names}, measured and simulated, and the error between them.",
            f"The joints with the largest error, where it is largest. Left the {_subject(comparison)}, right measured minus "
            "simulated; the grey band is what sensor noise alone would give.",
        )


def _subject(comparison: Comparison) -> str:
    return "motion" if comparison.signal == "position" else comparison.signal


def ranking(data: Mapping[str, Any]) -> Iterator[str]:
    """The effects that were tried, the best first."""
    entries = [e for e in data["ranking"] if e.get("held_out_chi2") is not None]
    if entries:
        entries.sort(key=lambda e: e["held_out_chi2"])
        best = min(entries, key=lambda e: e["held_out_chi2"])
        value = number(best["held_out_chi2"])
        yield "<h2>Effects tried</h2>"
        yield picture(
            figures.ranking(entries, data["effects"]),
            f"Held-out error with each effect; lowest is {effect_name(best['effect'])}, chi²/n {value}.",
            "Each was added, everything fitted again, and judged on recordings that the fit had not seen. Right: by how "
            "much the sum over joints of log chi²/n falls, with its 95 % interval. Blue: named by the verdict.",
        )
        rows = []
        for e in entries:
            low, high = (e["gain"] + side * figures.SPREAD * e["gain_error"] for side in (-1, 1))
            fall = f"{number(e['gain'])} [{number(low)}, {number(high)}]"
            rows.append([effect_name(e["effect"]), number(e["held_out_chi2"]), fall])
        yield "<details><summary>As numbers</summary>"
        yield table(["effect", "held-out chi²/n", "fall of log chi²/n [95 %]"], rows) + "</details>"


def heat_map(comparison: Comparison) -> Iterator[str]:
    """Error by joint and regime."""
    grid = comparison.grid(0)
    row, column = np.unravel_index(int(np.nanargmax(grid)), grid.shape)
    worst = f"{comparison.joints[row]}, {('all', *REGIMES)[column]}"
    yield "<h2>Which joint, when</h2>"
    yield picture(
        figures.heat_map(comparison),
        f"Error by joint and regime; for {comparison.labels[0]} largest at {worst}.",
        "Mean square error in units of the sensor noise: 1 is as good as can be measured. Empty: no sample.",
    )


def goes_with(where: Where, whose: str) -> Iterator[str]:
    """What the error goes with, and on which side it arises; whose: which of several models is meant."""
    of = f"{whose}'s " if whose else ""
    yield f"<h2>What the {of}error goes with</h2>"
    yield bullets(where.findings)
    joints = figures.worst_joints(where.comparison)
    if joints:
        names = ", ".join(where.comparison.joints[j] for j in joints)
        yield picture(
            figures.profiles(where, joints),
            f"Error of {names} against speed, angle, torque and time.",
            "Measured minus simulated: median and middle 68 %. Above each, the share of the error that goes with it.",
        )
    if np.isfinite(where.controller_share).any():
        yield picture(
            figures.sides(where),
            "Shares of controller and plant side in the unexplained effort, joint by joint.",
            "Whether the measured effort departs from what the command asks for, or the motion from what the "
            "effort gives.",
        )


def joint_table(comparison: Comparison) -> Iterator[str]:
    """Before and after, joint by joint."""
    rows, several = [], len(comparison.labels) > 1
    for j, joint in enumerate(comparison.joints):
        rms, noise = comparison.joint_rms[:, j], comparison.joint_noise[j]
        errors = [number(1e3 * v) for v in rms]
        change = [f"{100 * (rms[-1] / rms[0] - 1):+.0f} %".replace("-", "−")] if several and rms[0] > 0 else []
        change = change or (["-"] if several else [])
        rows.append(
            [joint, *errors, *change, number(1e3 * noise), number(rms[-1] / noise, 2), MILLI[comparison.units[j]]]
        )
    yield "<h2>Joint by joint</h2>"
    yield f"<p>Root-mean-square {comparison.signal} error over all usable samples.</p>"
    heads = [*comparison.labels, *(["change"] if several else []), "noise", "times noise", "unit"]
    yield table(["joint", *heads], rows)


def parameters(model: RobotModel) -> Iterator[str]:
    """The model's numbers with their intervals."""
    rows = model.parameters().rows
    known = [r for r in rows if r.interval]
    yield "<h2>Parameters</h2>"
    if known:
        yield picture(
            figures.forest(known),
            f"Values and 95 % intervals of {len(known)} parameters; the table below has the numbers.",
            "Values with their 95 % intervals, whose half width stands at the right. A dashed line marks where an effect "
            "would vanish.",
        )
    cells = []
    for r in rows:
        interval = " … ".join(number(v, 4) for v in r.interval) if r.interval else "–"
        cells.append([r.name, number(r.value, 4), interval, r.unit])
    yield f"<details><summary>All {len(rows)} parameters</summary>"
    yield table(["parameter", "value", "95 % interval", "unit"], cells) + "</details>"


def trust(data: Mapping[str, Any]) -> Iterator[str]:
    """How likely the verdict is to be an accident."""
    yield "<h2>How far to trust this verdict</h2>"
    yield bullets([alarm_sentence(data), false_alarm_sentence()])


def unseen(data: Mapping[str, Any] | None, undetermined: Sequence[str]) -> Iterator[str]:
    """What is not explained, and what these recordings cannot show; data: a diagnosis' JSON."""
    if data and data["unexplained"]:
        rows = [[joint, percent(share)] for joint, share in data["unexplained"].items()]
        yield "<h2>Left unexplained</h2><p>Share of the error beyond noise that stays.</p>"
        yield table(["joint", "unexplained"], rows)
    sentences = unseen_sentences(data) if data else []
    if undetermined:
        sentences.append(f"Parameters that this motion does not determine: {', '.join(undetermined)}.")
    if sentences:
        yield "<h2>What these sensors and this motion cannot show</h2>" + bullets(sentences)


def footer(comparison: Comparison) -> Iterator[str]:
    """Which recordings, and what was left out of them."""
    seconds = sum(r.duration for r in comparison.recordings)
    left_out = sum(int((~usable).sum()) for usable in comparison.signals.usable)
    total = sum(usable.size for usable in comparison.signals.usable)
    names = ", ".join(r.name for r in comparison.recordings)
    yield f"<footer><p>{len(comparison.recordings)} recordings, {seconds:.1f} s; {left_out} of {total} joint"
    yield f"samples left out as contact or faulty. {escape(names)}</p></footer>"
