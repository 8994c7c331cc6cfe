"""Training curves: a CSV file, and TensorBoard event files if TensorBoard is installed."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.files import atomic_file

CSV = "curves.csv"
EVENTS = "tensorboard"
COLUMNS = {name: name for name in ("step", "loss", "l1", "kl", "gradient")} | {"learning_rate": "rate"}  # heading
HINT = "no TensorBoard curves: install them with `pip install 'embodiedreamer-gym[tensorboard]'`; curves.csv has the same numbers"


class Curves:
    """Training curves in a folder; rows that an interrupted training wrote after `step` are dropped.

    note: a message for the user, empty if TensorBoard files are written too.
    """

    def __init__(self, folder: Path, step: int = 0) -> None:
        self._path = folder / CSV
        rows = []
        if self._path.is_file():
            with self._path.open(newline="", encoding="utf-8", errors="replace") as file:
                rows = [
                    row
                    for row in csv.reader(file)
                    if row and row[0].isdecimal() and len(row[0]) < 12 and int(row[0]) <= step
                ]
        with atomic_file(self._path, PolicyError) as part, part.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS.values(), *rows])
        self._writer, self.note = _event_writer(folder / EVENTS, step)

    def add(self, row: Mapping[str, float]) -> None:
        """Add the values of a step."""
        with self._path.open("a", newline="") as file:
            values = [row[name] for name in COLUMNS]
            csv.writer(file, lineterminator="\n").writerow([int(values[0]), *(f"{value:.9g}" for value in values[1:])])
        if self._writer is not None:
            for name, heading in list(COLUMNS.items())[1:]:
                self._writer.add_scalar(heading, row[name], int(row["step"]))

    def close(self) -> None:
        """Close the files."""
        if self._writer is not None:
            self._writer.close()


def _event_writer(folder: Path, step: int) -> tuple[Any, str]:
    """TensorBoard's writer and an empty note, or None and a note that says why."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None, HINT
    return SummaryWriter(str(folder), purge_step=step + 1 if step else None), ""
