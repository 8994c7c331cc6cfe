"""Tables of measures, as text for a terminal or as Markdown."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.tables import WIDTH, layout
from embodiedreamer_gym.vis_aligner.metrics.evaluate import Measures
from embodiedreamer_gym.vis_aligner.metrics.summary import Summary

COLUMNS = {  # measure -> heading, decimals, decimals of the sd
    "psnr": ("PSNR dB", 2, 1), "ssim": ("SSIM", 3, 3), "psnr.moving": ("moving dB", 2, 1),
    "psnr.arm and objects": ("arm+obj dB", 2, 1), "psnr.objects": ("objects dB", 2, 1), "iou.objects": ("obj IoU", 2, 2),
    "colour_shift": ("colour /255", 2, 1), "temporal_error": ("time /255", 2, 1),
    "gradient_psnr": ("gradient dB", 2, 1), "rfvd": ("rfvd", 0, 0), "lpips": ("LPIPS", 4, 3), "fvd": ("FVD", 1, 1),
}  # fmt: skip
SHOWN = ("psnr", "ssim", "psnr.moving", "psnr.arm and objects", "psnr.objects", "iou.objects", "colour_shift",
         "rfvd", "lpips", "fvd")  # fmt: skip
POINTS = 10  # largest number of chunks in a drift table

Rows = Mapping[str, Measures | Summary]


def table(rows: Rows, columns: Sequence[str] = SHOWN, markdown: bool = False) -> str:
    """Text table with one row per model or baseline: means, with ± sd over episodes if that fits into 110 columns.

    Columns without values are left out. Notes below the table give the reasons, the number of episodes, the IoU that
    true frames reach, and warnings. Raises: VisionError for no row, or a column that is not a measure.
    """
    if not rows:
        raise VisionError("there is no row to show; give at least one, name -> Measures or Summary.")
    if unknown := [name for name in columns if name not in COLUMNS and not any(name in _all(r) for r in rows.values())]:
        raise VisionError(f"columns {unknown} are not measures; choose from {', '.join(COLUMNS)} and those by class.")
    shown = [name for name in columns if any(_all(row).get(name) is not None for row in rows.values())]
    heads = ["", *(_column(name)[0] for name in shown)]
    cells = {sd: [[label, *(_cell(row, n, sd) for n in shown)] for label, row in rows.items()] for sd in (True, False)}
    if markdown:
        return _markdown(heads, cells[True]) + "\n\n" + "\n".join(f"- {n}" for n in _notes(rows, columns, shown, True))
    spread = max(map(len, layout(heads, cells[True]).splitlines())) <= WIDTH
    notes = _notes(rows, columns, shown, spread)
    return "\n".join([layout(heads, cells[spread]), *(textwrap.fill(note, WIDTH) for note in notes)])


def drift_table(rows: Rows, measure: str = "psnr", markdown: bool = False) -> str:
    """Text table of a measure by chunk, one row per model: up to ten chunks, evenly spread from the first to the last.

    Raises: VisionError for no row, or a measure without a curve.
    """
    curves = {label: row.drift.get(measure, ()) for label, row in rows.items()}
    count = max(map(len, curves.values()), default=0)
    if not count:
        names = dict.fromkeys(name for row in rows.values() for name in row.drift)
        raise VisionError(f"no row has a drift of {measure!r}; there are {', '.join(names) or 'none at all'}.")
    points = sorted({round(i * (count - 1) / max(1, min(POINTS, count) - 1)) for i in range(min(POINTS, count))})
    heading, decimals, _ = _column(measure)
    cells = [
        [label, *(_number(curve[k] if k < len(curve) else None, decimals) for k in points)]
        for label, curve in curves.items()
    ]
    heads = [f"{heading}, chunk", *(str(k + 1) for k in points)]
    return _markdown(heads, cells) if markdown else layout(heads, cells)


def _all(row: Measures | Summary) -> dict[str, float | None]:
    if isinstance(row, Measures):
        return dict(row.values)
    return {name: row[name] for name in (*row.figures, *row.distances)}


def _column(name: str) -> tuple[str, int, int]:
    """Heading and decimals of a measure; a measure without its own entry keeps its name."""
    return COLUMNS.get(name, (name, 2, 1))


def _cell(row: Measures | Summary, name: str, with_sd: bool) -> str:
    _, decimals, finer = _column(name)
    text = _number(_all(row).get(name), decimals)
    figure = row.figures.get(name) if isinstance(row, Summary) else None
    return f"{text}±{_number(figure.sd, finer)}" if with_sd and figure and figure.sd is not None else text


def _notes(rows: Rows, columns: Sequence[str], shown: Sequence[str], spread: bool) -> list[str]:
    """Notes below a table: number of episodes, IoU that true frames reach, reasons for absent columns, warnings."""
    notes = []
    if counts := dict.fromkeys(str(row.episodes) for row in rows.values() if isinstance(row, Summary)):
        notes.append(f"mean{' ± sd' if spread else ''} over episodes: {', '.join(counts)}")
    ceilings = [c for row in rows.values() if (c := _all(row).get("iou_ceiling.objects")) is not None]
    if "iou.objects" in shown and ceilings:
        notes.append(f"obj IoU of the true frames themselves: {ceilings[0]:.2f}")
    reasons = {name: row.reasons[name] for row in rows.values() for name in columns if name in row.reasons}
    notes += [f"{_column(name)[0]}: none; {reason}" for name, reason in reasons.items()]
    return notes + list(dict.fromkeys(w for row in rows.values() if isinstance(row, Summary) for w in row.warnings))


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
