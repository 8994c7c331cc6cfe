"""Small pieces of HTML for the page; every name that comes from a file is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from embodiedreamer_gym.diagnosis.regimes import REGIME_HEADS
from embodiedreamer_gym.io.tables import milli, number
from embodiedreamer_gym.robot import ParameterRow
from embodiedreamer_gym.workbench.scene import colour

STYLE = "font-family:system-ui,sans-serif;font-size:0.82em;padding:0.1em 0.75em 0.5em;line-height:1.35;overflow-wrap:anywhere"


# While no server answers, viser disables the pointer in all of its panels without a message.
LOST = f"""<style>.lost {{display: none}} [style*="pointer-events: none"] .lost {{display: block}}</style>
<div class="lost" style="{STYLE};background:#f4be42;color:#000;font-weight:700;padding-top:0.5em">
The workbench does not answer. Its command may have ended: what was accepted is on disk. Start the command again and
reload this page.</div>"""


def block(text: str) -> str:
    """A block with the page's font and margin."""
    return f'<div style="{STYLE}">{text}</div>'


def bars(steps: Sequence[tuple[str, float]], noise: float, unit: str) -> str:
    """The held-out errors of steps (label, error) as bars with the noise level; the last bar is highlighted."""
    top = max([noise, *(error for _, error in steps)]) or 1.0
    rows = ['<div style="color:#6b727c">held-out error</div>']
    for k, (label, error) in enumerate(steps):
        fill = "#1f6fb2" if k == len(steps) - 1 else "#c3c9d1"
        rows.append(
            f'<div style="margin-top:0.35em;display:flex;justify-content:space-between"><span>{escape(label.replace("_", " "))}</span>'
            f"<b>{milli(error, unit)}</b></div>"
            f'<div style="background:#eef0f3;height:0.7em;position:relative;border-radius:2px"><div style="background:{fill};'
            f'height:100%;width:{100 * error / top:.1f}%;border-radius:2px"></div><div style="position:absolute;top:-0.15em;'
            f'bottom:-0.15em;left:{100 * noise / top:.1f}%;border-left:2px dashed #5b626c"></div></div>'
        )
    return block(
        "".join(rows) + f'<div style="color:#6b727c;margin-top:0.35em">dashed: sensor noise {milli(noise, unit)}</div>'
    )


def error_map(joints: Sequence[str], chi2: np.ndarray) -> str:
    """chi2/n (n, 7) of each joint by regime as a coloured table; 1 is the sensor noise."""
    cell = "padding:0.25em 0.2em;text-align:center;border-radius:3px"
    head = "".join(
        f'<th style="font-weight:500;color:#6b727c;padding:0.2em">{name}</th>' for name in ("", *REGIME_HEADS)
    )
    rows = []
    for joint, values in zip(joints, chi2, strict=True):
        cells = []
        for value in values:
            shown = colour(float(np.sqrt(value))) if np.isfinite(value) else (255, 255, 255)
            ink = "#fff" if np.isfinite(value) and sum(shown) < 380 else "#22262c"
            cells.append(
                f'<td style="{cell};background:rgb{shown};color:{ink}">{number(value, 2) if np.isfinite(value) else "–"}</td>'
            )
        rows.append(f'<tr><td style="padding-right:0.4em">{escape(joint)}</td>{"".join(cells)}</tr>')
    return block(f'<table style="width:100%;border-spacing:2px"><tr>{head}</tr>{"".join(rows)}</table>')


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A plain table."""
    top = "".join(
        f'<th style="text-align:left;font-weight:500;color:#6b727c;padding-right:0.6em">{escape(h)}</th>' for h in heads
    )
    body = "".join(
        "<tr>" + "".join(f'<td style="padding-right:0.6em">{escape(c)}</td>' for c in row) + "</tr>" for row in rows
    )
    return block(f'<table style="border-spacing:0 0.15em">{f"<tr>{top}</tr>" if any(heads) else ""}{body}</table>')


def sentence(text: str, strong: bool = False) -> str:
    """A sentence."""
    return block(f"<b>{escape(text)}</b>" if strong else escape(text))


def values(rows: Sequence[ParameterRow]) -> str:
    """Values by joint, with 95 % intervals where a fit gave them."""
    groups = {r.key.parameter: f"{r.key.parameter.replace('_', ' ')} [{r.unit}]" for r in rows}
    cells = []
    for place in dict.fromkeys(r.key.place for r in rows):
        own = {r.key.parameter: r for r in rows if r.key.place == place}
        cells.append([place, *(_value(own[name]) if name in own else "" for name in groups)])
    return table(("at", *groups.values()), cells) if cells else ""


def _value(row: ParameterRow) -> str:
    return number(row.value) + (f" ({number(row.interval[0])} … {number(row.interval[1])})" if row.interval else "")
