"""Shared by all figures of a report: colours, axes, and a figure as PNG."""

from __future__ import annotations

import base64
import io
import warnings

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

INK, GREY, BAND = "#222222", "#8a8f98", "#d5d9de"
BEFORE, AFTER = "#d1702a", "#1f6fb2"
WIDTH = 9.6  # in; a figure fills the width of a laptop screen
RESOLUTION = 150  # dots per inch; sharp on a screen of twice the usual density


def png(figure: Figure) -> str:
    """A figure as a data URI of its PNG."""
    data = io.BytesIO()
    FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in a script that the font lacks
        figure.savefig(data, format="png", dpi=RESOLUTION)
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode('ascii')}"


def short(name: str, most: int = 26) -> str:
    """A name for a figure: shortened in the middle if it is long, with its dollar signs escaped."""
    cut = name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-(most - most // 2) :]}"
    return cut.replace("$", r"\$")


def tidy(axes: Axes) -> None:
    """Give axes a light frame and small tick labels."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, labelsize=8, width=0.6)


def plain_log(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: 0.5, 1, 2."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
