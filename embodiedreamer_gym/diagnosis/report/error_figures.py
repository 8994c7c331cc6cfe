"""Figures of a model's error: each function takes data and returns a matplotlib Figure, without global state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from embodiedreamer_gym.diagnosis.comparison import Comparison
from embodiedreamer_gym.diagnosis.error_breakdown import QUANTITIES, ErrorBreakdown
from embodiedreamer_gym.diagnosis.regimes import REGIME_HEADS
from embodiedreamer_gym.diagnosis.report.drawing import AFTER, BAND, BEFORE, GREY, INK, WIDTH, short, tidy
from embodiedreamer_gym.io.tables import MILLI

WINDOW = 8.0  # s of a recording that an overlay shows
SHOWN = 3  # joints in an overlay


def worst_joints(
    comparison: Comparison, model: int = 0, at_fault: Sequence[str] = (), most: int = SHOWN
) -> list[int]:  # fmt: skip
    """Columns of the joints to show: those at fault, then those with the largest error in units of their noise."""
    chi2 = np.nan_to_num(comparison.joint_chi2[model], nan=-1.0)
    first = np.array([joint in at_fault for joint in comparison.joints])
    return [int(j) for j in np.lexsort((-chi2, ~first))[:most] if chi2[j] >= 0]


def overlay(comparison: Comparison, joints: Sequence[int], before: int = 0) -> Figure:
    """Measured motion of joints with that of model `before` and of the last model; on the right their errors.

    The grey band is +-2 standard deviations of the sensor noise.
    """
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(joints)), layout="constrained")
    grid = figure.subplots(len(joints), 2, squeeze=False)
    last = len(comparison.labels) - 1
    for (left, right), j in zip(grid, joints, strict=True):
        run, rows = _worst_window(comparison, j, before)
        recording = comparison.recordings[run]
        time = recording.time[rows] - recording.time[0]
        unit = comparison.units[j]
        sigma = recording.sigma[j] if comparison.signal == "position" else comparison.joint_noise[j]
        right.axhspan(-2e3 * sigma, 2e3 * sigma, color=BAND, lw=0, label="noise (±2 sd)")
        for model in sorted({before, last}):
            simulated = _simulated(comparison, model)[run][rows, j]
            error = comparison.errors(model)[run][rows, j]
            if model == before:
                left.plot(time, simulated + error, color=INK, lw=1.6, label="measured")
            line = {"color": AFTER if model == last else BEFORE, "label": short(comparison.labels[model], 40)}
            left.plot(time, simulated, lw=1.1, ls="--" if model < last else "-", **line)
            right.plot(time, 1e3 * error, lw=0.9, **line)
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
    """The compared signal (T, n) of a model's rollouts."""
    runs = comparison.rollouts[model]
    if comparison.signal == "position":
        return [run.position for run in runs]
    return [run.effort for run in runs]


def _worst_window(comparison: Comparison, joint: int, model: int) -> tuple[int, slice]:
    """Recording and rows in which a model's error at a joint is largest."""
    best, place = -1.0, (0, slice(0, len(comparison.recordings[0].time)))
    errors, usable = comparison.errors(model), comparison.signals.usable
    for run, recording in enumerate(comparison.recordings):
        square = np.where(usable[run][:, joint], errors[run][:, joint], 0.0) ** 2
        size = min(len(square), max(2, round(WINDOW * recording.hz)))
        total = np.convolve(square, np.ones(size), mode="valid") / size
        start = int(np.argmax(total))
        if total[start] > best:
            best, place = float(total[start]), (run, slice(start, start + size))
    return place


def heat_map(comparison: Comparison, before: int = 0) -> Figure:
    """chi2/n by joint and regime, for model `before` and for the last model."""
    models = sorted({before, len(comparison.labels) - 1})
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
        axes.set_xticks(range(len(REGIME_HEADS)), REGIME_HEADS, fontsize=8)
        names = [short(j) for j in comparison.joints] if model == before else [""] * joints
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


def profiles(breakdown: ErrorBreakdown, joints: Sequence[int]) -> Figure:
    """Error of joints against speed, angle, torque and time: median and the middle 68 % of each bin."""
    figure = Figure(figsize=(WIDTH, 0.5 + 1.6 * len(joints)), layout="constrained")
    grid = figure.subplots(len(joints), len(QUANTITIES), squeeze=False, sharey="row")
    comparison = breakdown.comparison
    for line, j in zip(grid, joints, strict=True):
        joint, unit = comparison.joints[j], comparison.units[j]
        angle = comparison.models[0].units[j]
        units = {"speed": f"{angle}/s", "angle": angle, "torque": "N m", "time": "s"}
        own = {p.against: p for p in breakdown.profiles if p.joint == joint}
        for axes, quantity in zip(line, QUANTITIES, strict=True):
            tidy(axes)
            axes.axhline(0, color=GREY, lw=0.6)
            axes.set_xlabel(f"{quantity} [{units[quantity]}]", fontsize=8)
            axes.locator_params(axis="x", nbins=5)
            if quantity in own:
                p = own[quantity]
                axes.fill_between(p.centre, 1e3 * p.low, 1e3 * p.high, color=AFTER, alpha=0.22, lw=0)
                axes.plot(p.centre, 1e3 * p.median, color=AFTER, lw=1.4)
                axes.set_title(f"{p.share:.0%} of the variance", fontsize=8, loc="right", color=GREY)
        line[0].set_ylabel(f"{short(joint)}\n[{MILLI[unit]}]", fontsize=9)
    return figure


def attribution(breakdown: ErrorBreakdown) -> Figure:
    """Share of controller and plant in the unexplained effort, by joint."""
    joints = [j for j in range(len(breakdown.controller_share)) if np.isfinite(breakdown.controller_share[j])]
    figure = Figure(figsize=(WIDTH, 0.8 + 0.27 * len(joints)), layout="constrained")
    axes = figure.subplots()
    share = 100 * breakdown.controller_share[joints]
    rows = range(len(joints))
    axes.barh(rows, share, color=BEFORE, height=0.66, label="controller side (command to effort)")
    axes.barh(rows, 100 - share, left=share, color=AFTER, height=0.66, label="plant side (effort to motion)")
    axes.set_yticks(rows, [short(breakdown.comparison.joints[j]) for j in joints])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the unexplained effort [%]", fontsize=9)
    tidy(axes)
    figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure
