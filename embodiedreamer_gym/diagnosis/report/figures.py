"""Pictures of a diagnosis, one function each: data in, matplotlib Figure out, no global state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from embodiedreamer_gym.diagnosis.compare import Comparison, effort_scale
from embodiedreamer_gym.diagnosis.error_breakdown import AGAINST, Where
from embodiedreamer_gym.io.tables import MILLI, number
from embodiedreamer_gym.robot import ParameterRow

INK, GREY, BAND = "#222222", "#8a8f98", "#d5d9de"
BEFORE, AFTER = "#d1702a", "#1f6fb2"
WIDTH = 9.6  # in; a picture fills the page of a laptop
WINDOW = 8.0  # s of a recording that an overlay shows
SHOWN = 3  # joints of an overlay
SPREAD = 1.96  # standard errors to either side: 95 % of a normal distribution


def short(name: str, most: int = 26) -> str:
    """A name for a picture: cut in the middle when long, its dollar signs no mathematics."""
    cut = name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-(most - most // 2) :]}"
    return cut.replace("$", r"\$")


def tidy(axes: Axes) -> None:
    """Light frame and small figures."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, labelsize=8, width=0.6)


def plain_log(axis: Axis) -> None:
    """Figures of a logarithmic axis as one reads them: 0.5, 1, 2."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def worst_joints(comparison: Comparison, most: int = SHOWN) -> list[int]:
    """Columns of the joints whose first model fails most, in units of their noise."""
    chi2 = np.nan_to_num(comparison.joint_chi2[0], nan=-1.0)
    return [int(j) for j in np.argsort(-chi2, kind="stable")[:most] if chi2[j] >= 0]


def overlay(comparison: Comparison, joints: Sequence[int]) -> Figure:
    """Measured and simulated motion of joints, and below each other the error with a band of two noises."""
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(joints)), layout="constrained")
    grid = figure.subplots(len(joints), 2, squeeze=False)
    last = len(comparison.labels) - 1
    for (left, right), j in zip(grid, joints, strict=True):
        run, rows = _worst_window(comparison, j)
        recording = comparison.recordings[run]
        time = recording.time[rows] - recording.time[0]
        unit = comparison.units[j]
        by_position = comparison.signal == "position"
        sigma = recording.sigma[j] if by_position else comparison.joint_noise[j]
        first = _simulated(comparison, 0)[run][rows, j]
        left.plot(time, first + comparison.errors(0)[run][rows, j], color=INK, lw=1.6, label="measured")
        right.axhspan(-2e3 * sigma, 2e3 * sigma, color=BAND, lw=0, label="noise (±2 sd)")
        for model in sorted({0, last}):
            color = AFTER if model == last else BEFORE
            error = comparison.errors(model)[run][rows, j]
            label = short(comparison.labels[model], 40)
            left.plot(
                time,
                _simulated(comparison, model)[run][rows, j],
                color=color,
                lw=1.1,
                ls="--" if model == 0 < last else "-",
                label=label,
            )
            right.plot(time, 1e3 * error, color=color, lw=0.9, label=label)
        left.set_ylabel(f"{short(comparison.joints[j])}\n[{'0..1' if unit == '1' else unit}]", fontsize=9)
        right.set_ylabel(f"error [{MILLI[unit]}]", fontsize=9)
        left.set_title(short(recording.name, 40), fontsize=8, loc="left", color=GREY)
        right.axhline(0, color=GREY, lw=0.6)
        for axes in (left, right):
            tidy(axes)
            axes.margins(x=0)
    for axes in grid[-1]:
        axes.set_xlabel("time in the recording [s]", fontsize=9)
    handles, labels = grid[0][0].get_legend_handles_labels()
    band, band_label = (part[:1] for part in grid[0][1].get_legend_handles_labels())
    figure.legend(handles + band, labels + band_label, loc="outside upper left", ncols=4, frameon=False, fontsize=9)
    return figure


def _simulated(comparison: Comparison, model: int) -> list[np.ndarray]:
    """What a model's runs (T, n) show of the compared signal."""
    runs = comparison.rollouts[model]
    if comparison.signal == "position":
        return [run.position for run in runs]
    scale = effort_scale(comparison.recordings, runs) if comparison.unit == "A" else 1.0
    return [scale * run.torque for run in runs]


def _worst_window(comparison: Comparison, joint: int) -> tuple[int, slice]:
    """Recording and rows in which the first model's error in a joint is largest."""
    best, place = -1.0, (0, slice(0, len(comparison.recordings[0].time)))
    errors, usable = comparison.errors(0), comparison.signals.usable
    for run, recording in enumerate(comparison.recordings):
        square = np.where(usable[run][:, joint], errors[run][:, joint], 0.0) ** 2
        size = min(len(square), max(2, round(WINDOW * recording.hz)))
        total = np.convolve(square, np.ones(size), mode="valid") / size
        start = int(np.argmax(total))
        if total[start] > best:
            best, place = float(total[start]), (run, slice(start, start + size))
    return place


def heat_map(comparison: Comparison) -> Figure:
    """chi2/n by joint and regime, of the first and the last model."""
    models = sorted({0, len(comparison.labels) - 1})
    joints = len(comparison.joints)
    figure = Figure(figsize=(WIDTH, max(1.1 + 0.3 * joints, 2.0)), layout="constrained")
    grids = [comparison.grid(m) for m in models]
    top = max(float(np.nanmax(np.concatenate(grids))), 20.0)
    for axes, model, values in zip(figure.subplots(1, len(models), squeeze=False)[0], models, grids, strict=True):
        shown = np.clip(values, 1.0, None)
        axes.imshow(shown, norm=LogNorm(1.0, top), cmap="YlOrRd", aspect="auto")
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                dark = np.log(max(value, 1.0)) > 0.6 * np.log(top)
                axes.text(column, row, _compact(value), ha="center", va="center", fontsize=7.5,
                          color="white" if dark else INK)  # fmt: skip
        axes.set_xticks(range(7), ["all", "hold", "slow", "fast", "reversal", "accel.", "loaded"], fontsize=8)
        names = [short(j) for j in comparison.joints] if model == 0 else [""] * joints
        axes.set_yticks(range(joints), names, fontsize=8)
        axes.set_title(short(comparison.labels[model], 44), fontsize=9, loc="left")
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    bar = figure.colorbar(figure.axes[0].images[0], ax=figure.axes, label="chi²/n", shrink=0.9, pad=0.01)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    return figure


def _compact(value: float) -> str:
    if value < 9.95:
        return f"{value:.1f}"
    return f"{value:.0f}" if value < 9999.5 else f"{value / 1000:.0f}k"


def staircase(steps: Sequence[tuple[str, float]], noise: float, unit: str = "mrad") -> Figure:
    """Error falling from step to step to the noise floor; steps (label, error), shown in thousandths: `unit`."""
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


def ranking(entries: Sequence[Mapping], named: Sequence[str], most: int = 15) -> Figure:
    """Held-out chi2/n of each effect tried, the best first, and its gain's interval; the named ones are marked."""
    entries = [e for e in sorted(entries, key=lambda e: e["held_out_chi2"]) if np.isfinite(e["held_out_chi2"])][:most]
    figure = Figure(figsize=(WIDTH, 0.9 + 0.27 * len(entries)), layout="constrained")
    axes, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    values = [float(e["held_out_chi2"]) for e in entries]
    rows = range(len(entries))
    colors = [AFTER if e["effect"] in named else "#9aa1ab" for e in entries]
    axes.barh(rows, values, color=colors, height=0.68)
    for row, e, color in zip(rows, entries, colors, strict=True):
        right.errorbar(e["gain"], row, xerr=SPREAD * e["gain_error"], fmt="o", color=color, ms=4.5, capsize=3)
    right.axvline(0.0, color=GREY, lw=1.0, ls="--")
    right.set_xlabel("fall of log chi²/n, 95 % interval", fontsize=9)
    right.tick_params(axis="y", length=0)
    tidy(right)
    for row, value in zip(rows, values, strict=True):
        axes.annotate(number(value), (value, row), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(rows, [short(str(e["effect"]).replace("_", " "), 40) for e in entries])
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


def forest(rows: Sequence[ParameterRow], columns: int = 3) -> Figure:
    """Values with their 95 % intervals, a panel for each group of parameters."""
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


def profiles(found: Where, joints: Sequence[int]) -> Figure:
    """Error of joints against speed, angle, torque and time: median and the middle 68 % of each bin."""
    figure = Figure(figsize=(WIDTH, 0.5 + 1.6 * len(joints)), layout="constrained")
    grid = figure.subplots(len(joints), len(AGAINST), squeeze=False, sharey="row")
    comparison = found.comparison
    for line, j in zip(grid, joints, strict=True):
        joint, unit = comparison.joints[j], comparison.units[j]
        angle = comparison.models[0].units[j]
        units = {"speed": f"{angle}/s", "angle": angle, "torque": "N m", "time": "s"}
        own = {p.against: p for p in found.profiles if p.joint == joint}
        for axes, against in zip(line, AGAINST, strict=True):
            tidy(axes)
            axes.axhline(0, color=GREY, lw=0.6)
            axes.set_xlabel(f"{against} [{units[against]}]", fontsize=8)
            axes.locator_params(axis="x", nbins=5)
            if against in own:
                p = own[against]
                axes.fill_between(p.centre, 1e3 * p.low, 1e3 * p.high, color=AFTER, alpha=0.22, lw=0)
                axes.plot(p.centre, 1e3 * p.median, color=AFTER, lw=1.4)
                axes.set_title(f"{p.share:.0%} of the error", fontsize=8, loc="right", color=GREY)
        line[0].set_ylabel(f"{short(joint)}\n[{MILLI[unit]}]", fontsize=9)
    return figure


def sides(found: Where) -> Figure:
    """Controller's and plant's share of the unexplained effort, by joint."""
    known = [j for j in range(len(found.controller_share)) if np.isfinite(found.controller_share[j])]
    figure = Figure(figsize=(WIDTH, 0.8 + 0.27 * len(known)), layout="constrained")
    axes = figure.subplots()
    share = 100 * found.controller_share[known]
    rows = range(len(known))
    axes.barh(rows, share, color=BEFORE, height=0.66, label="controller side (command to effort)")
    axes.barh(rows, 100 - share, left=share, color=AFTER, height=0.66, label="plant side (effort to motion)")
    axes.set_yticks(rows, [short(found.comparison.joints[j]) for j in known])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the unexplained effort [%]", fontsize=9)
    tidy(axes)
    figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure
