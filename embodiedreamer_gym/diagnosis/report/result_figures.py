"""Figures of a diagnosis: the fall of the error, the effects that were tried, the parameters' intervals."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from embodiedreamer_gym.diagnosis.report.drawing import AFTER, BAND, BEFORE, GREY, INK, WIDTH, plain_log, short, tidy
from embodiedreamer_gym.diagnosis.search_state import Ranked
from embodiedreamer_gym.io.tables import number
from embodiedreamer_gym.robot import ParameterRow

SPREAD = 1.96  # standard errors to either side: 95 % of a normal distribution


def staircase(steps: Sequence[tuple[str, float]], noise: float, unit: str = "mrad") -> Figure:
    """Error of each step (label, error), with the noise; unit: name of a thousandth of the error's unit."""
    figure = Figure(figsize=(WIDTH, 3.1), layout="constrained")
    axes = figure.subplots()
    levels = [1e3 * error for _, error in steps]
    floor = 1e3 * noise
    positive = [v for v in (*levels, floor) if v > 0]
    log = bool(positive) and max(positive) > 8 * min(positive)
    bottom = 0.6 * min(positive) if log else 0.0
    last = len(levels) - 1
    for k, level in enumerate(levels):
        color = BEFORE if k == 0 and last else AFTER
        axes.fill_between([k, k + 0.92], bottom, level, color=color, alpha=0.16, lw=0)
        axes.plot([k, k + 0.92], [level, level], color=color, lw=2.6, solid_capstyle="butt")
        fall = f"  ({100 * (level / levels[k - 1] - 1):+.0f} %)" if k and levels[k - 1] > 0 else ""
        axes.annotate(f"{number(level)} {unit}{fall}".replace("-", "−"), (k + 0.46, level), xytext=(0, 5), ha="center",
                      textcoords="offset points", fontsize=9.5, color=INK)  # fmt: skip
    axes.axhspan(bottom, floor, color=BAND, lw=0, zorder=0)
    axes.axhline(floor, color=GREY, lw=1.0, ls="--")
    axes.annotate(f"sensor noise {number(floor)} {unit}", (0.0, floor), xytext=(4, -11), fontsize=8.5,
                  textcoords="offset points", color="#3b4048")  # fmt: skip
    axes.set_xticks([k + 0.46 for k in range(len(levels))], [short(label, 34) for label, _ in steps], fontsize=9.5)
    axes.set_xlim(-0.05, len(levels))
    if log:
        axes.set_yscale("log")
        plain_log(axes.yaxis)
    top = max(*levels, floor)
    axes.set_ylim(bottom, top * (top / bottom) ** 0.2 if log else 1.2 * max(top, 1e-9))
    axes.set_ylabel(f"error [{unit}]" + (" (log)" if log else ""), fontsize=9)
    tidy(axes)
    return figure


def ranking(entries: Sequence[Ranked], named: Sequence[str], most: int = 15) -> Figure:
    """Held-out chi2/n of the tried effects in the given order, and their gains' intervals; named ones are marked."""
    entries = entries[:most]
    figure = Figure(figsize=(WIDTH, 0.9 + 0.27 * len(entries)), layout="constrained")
    axes, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    values = [e.held_out_chi2 for e in entries]
    rows = range(len(entries))
    colors = [AFTER if e.effect in named else "#9aa1ab" for e in entries]
    axes.barh(rows, values, color=colors, height=0.68)
    for row, e, color in zip(rows, entries, colors, strict=True):
        right.errorbar(e.gain, row, xerr=SPREAD * e.gain_error, fmt="o", color=color, ms=4.5, capsize=3)
    right.axvline(0.0, color=GREY, lw=1.0, ls="--")
    right.set_xlabel("fall of log chi²/n, 95 % interval", fontsize=9)
    right.tick_params(axis="y", length=0)
    tidy(right)
    for row, value in zip(rows, values, strict=True):
        axes.annotate(number(value), (value, row), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(rows, [short(e.effect.replace("_", " "), 40) for e in entries])
    axes.invert_yaxis()
    if values and max(values) > 30 * max(min(values), 1e-12):
        axes.set_xscale("log")
        axes.set_xlim(0.6 * max(min(*values, 1.0), 1e-12), 2 * max(values))
        plain_log(axes.xaxis)
    axes.margins(x=0.12)
    axes.axvline(1.0, color=GREY, lw=1.0, ls="--")
    axes.set_xlabel("held-out chi²/n with it (dashed: sensor noise)", fontsize=9)
    tidy(axes)
    return figure


def intervals(rows: Sequence[ParameterRow], columns: int = 3) -> Figure:
    """Values with their 95 % intervals, one panel for each group of parameters."""
    groups: dict[str, list[ParameterRow]] = {}
    for row in rows:
        groups.setdefault(str(row.key.group), []).append(row)
    columns = min(columns, len(groups))
    lines = -(-len(groups) // columns)
    tallest = max(len(members) for members in groups.values())
    room = ConstrainedLayoutEngine(w_pad=0.12)  # in; the numbers at the right belong to the panel at their left
    figure = Figure(figsize=(WIDTH, lines * (0.85 + 0.21 * tallest)), layout=room)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, (group, members) in zip(panels, groups.items(), strict=False):
        for k, row in enumerate(members):
            if row.interval:
                axes.plot(row.interval, (k, k), color=AFTER, lw=1.8, solid_capstyle="round")
                half = 100 * (row.interval[1] - row.interval[0]) / 2 / max(abs(row.value), 1e-12)
                axes.annotate(f"±{number(half, 2)} %" if half < 999.5 else "±∞", (1.0, k), xycoords=("axes fraction", "data"),
                              xytext=(3, 0), textcoords="offset points", va="center", fontsize=7, color=GREY)  # fmt: skip
            axes.plot(row.value, k, "o", color=AFTER if row.interval else "white", mec=AFTER, ms=3.8)
            if row.off is not None and row.off == 0:
                axes.axvline(0, color=GREY, lw=0.8, ls="--")
        axes.set_yticks(range(len(members)), [short(m.key.place, 18) for m in members])
        axes.set_ylim(len(members) - 0.5, -0.5)
        name = group.replace("_", " ").replace(".", ": ")
        axes.set_title(f"{short(name, 40)} [{members[0].unit}]", fontsize=9, loc="left")
        axes.grid(axis="x", color="#eceef0", lw=0.7)
        ends = [v for m in members for v in (m.value, *(m.interval or ()))]
        if min(ends) > 0 and max(ends) > 20 * min(ends):
            axes.set_xscale("log")
            plain_log(axes.xaxis)
        else:
            axes.locator_params(axis="x", nbins=5)
        tidy(axes)
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    return figure
