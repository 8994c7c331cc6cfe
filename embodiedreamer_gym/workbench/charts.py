"""Charts of one joint over time: its error compared with the noise, and command, measured and simulated motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from embodiedreamer_gym.io.tables import MILLI

MOST = 1500  # most samples of a chart
MEASURED, COMMAND, SIMULATED, BEFORE = "#22262c", "#9aa1ab", "#1f6fb2", "#d1702a"
BAND = "rgba(120,128,140,0.22)"
AXIS = {"font": "11px sans-serif", "labelSize": 18, "labelFont": "11px sans-serif", "size": 44}


def line(label: str, stroke: str, width: float = 1.4, dash: tuple[int, int] | None = None) -> dict[str, Any]:
    """A line without markers."""
    return {
        "label": label,
        "stroke": stroke,
        "width": width,
        "points": {"show": False},
        **({"dash": list(dash)} if dash else {}),
    }


def mark(label: str, stroke: str) -> dict[str, Any]:
    """A dot at the current time."""
    return {"label": label, "stroke": stroke, "width": 0, "points": {"show": True, "size": 9, "fill": stroke}}


def round_ends(low: float, high: float) -> tuple[float, float]:
    """Ends of an axis around these values, rounded to a tenth, fifth or half of the decade of their span."""
    span = max(high - low, 1e-9)
    step = 10.0 ** np.floor(np.log10(span))
    step *= 0.1 if span < 2 * step else 0.2 if span < 5 * step else 0.5
    return float(np.floor(low / step - 0.25) * step), float(np.ceil(high / step + 0.25) * step)


def _scales(ends: tuple[tuple[float, float], tuple[float, float]]) -> dict[str, Any]:
    return {"x": {"time": False, "range": ends[0]}, "y": {"range": ends[1]}}


class Chart:
    """A chart in the page; `draw` thins arrays to at most MOST samples."""

    def __init__(
        self, gui: Any, series: list[dict[str, Any]], unit: str, bands: list[dict[str, Any]], height: int
    ) -> None:
        self._rows, self._ends = np.arange(2), ((0.0, 1.0), (0.0, 1.0))
        self._data: tuple[np.ndarray, ...] = (np.arange(2.0),) + (np.full(2, np.nan),) * len(series)
        self._handle = gui.add_uplot(
            self._data, ({"label": "s"}, *series), scales=_scales(self._ends),
            bands=tuple(bands) or None, height=height,
            axes=({"label": "time [s]", **AXIS, "size": 34}, {"label": unit, **AXIS}),
            legend={"show": True, "live": False}, cursor={"drag": {"x": True, "y": False}}, padding=(6, 10, 0, 0),
        )  # fmt: skip

    @property
    def data(self) -> tuple[np.ndarray, ...]:
        """The data drawn: seconds, then each series."""
        return self._data

    def draw(self, time: np.ndarray, *series: np.ndarray | None, unit: str | None = None) -> None:
        """Draw series (T,) over seconds (T,); the last one is the mark."""
        self._rows = np.unique(np.linspace(0, len(time) - 1, min(MOST, len(time))).astype(int))
        nothing = np.full(len(self._rows), np.nan)
        self._data = (
            time[self._rows],
            *(nothing if s is None else np.asarray(s, float)[self._rows] for s in series),
            nothing,
        )
        if unit is not None and self._handle.axes[1]["label"] != unit:
            self._handle.axes = (self._handle.axes[0], {**self._handle.axes[1], "label": unit})
        given = np.concatenate(self._data[1:])
        given = given[np.isfinite(given)]
        ends = ((float(time[0]), float(time[-1])), round_ends(float(given.min()), float(given.max())))
        if ends != self._ends:  # uPlot cannot find the range of a series with gaps
            self._ends = ends
            self._handle.scales = _scales(ends)
        self._handle.data = self._data

    def point(self, sample: int, series: int) -> None:
        """Place the mark on a series at a sample."""
        at = int(np.searchsorted(self._rows, sample).clip(0, len(self._rows) - 1))
        marked = np.full(len(self._rows), np.nan)
        marked[at] = self._data[1 + series][at]
        self._data = (*self._data[:-1], marked)
        self._handle.data = self._data


def error_chart(gui: Any) -> Chart:
    """Error of a joint with the model shown and with the last kept one, and two standard deviations of noise."""
    series = [
        line("noise +2 sd", BAND, 0),
        line("noise −2 sd", BAND, 0),
        line("last kept", BEFORE, 1.1, (4, 3)),
        line("current", SIMULATED, 1.6),
    ]
    return Chart(gui, [*series, mark("current time", "#cc2924")], MILLI["rad"], [{"series": [1, 2], "fill": BAND}], 210)


def motion_chart(gui: Any) -> Chart:
    """Command, measured and simulated position of a joint."""
    series = [line("command", COMMAND, 1.1), line("measured", MEASURED, 1.7), line("simulated", SIMULATED, 1.3)]
    return Chart(gui, [*series, mark("current time", "#cc2924")], "rad", [], 210)
