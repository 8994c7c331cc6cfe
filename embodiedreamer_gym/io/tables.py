"""Text tables for a terminal: the first column wraps, the others are right-aligned."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

WIDTH = 110  # columns of a terminal
MILLI = {"rad": "mrad", "m": "mm", "1": "1e-3", "N m": "mN m", "A": "mA"}  # a joint's unit -> a thousandth of it


def layout(headers: Sequence[str], rows: Sequence[Sequence[str]], width: int = WIDTH) -> str:
    """Text table of headers and rows, at most `width` columns wide; a first cell that is too long wraps."""
    sizes = [max(len(row[i]) for row in (headers, *rows)) for i in range(1, len(headers))]
    first = max(len(row[0]) for row in (headers, *rows))
    first = max(8, min(first, width - sum(sizes) - 2 * len(sizes)))
    lines = []
    for row in (headers, *rows):
        parts = textwrap.wrap(row[0], first, break_on_hyphens=False) or [""]
        cells = "".join(f"  {cell:>{size}}" for cell, size in zip(row[1:], sizes, strict=True))
        lines += [(f"{parts[0]:<{first}}" + cells).rstrip(), *parts[1:]]
    return "\n".join(lines)


def number(value: float | None, digits: int = 3) -> str:
    """A number with `digits` significant digits, without an exponent from 1e-3 to 1e6; "-" for None or not finite."""
    if value is None or not math.isfinite(value):
        return "-"
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:.{min(max(decimals, 0), 6)}f}"


def milli(value: float | None, unit: str = "rad") -> str:
    """A value in thousandths of its unit, such as "2.88 mrad"."""
    return f"{number(None if value is None else 1e3 * value)} {MILLI[unit]}"


def finite(value: float) -> float | None:
    """The number for JSON; None where it is not finite."""
    return float(value) if math.isfinite(value) else None
