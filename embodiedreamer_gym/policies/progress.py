"""Progress of long work on stderr: how far it is, and how long it will take."""

from __future__ import annotations

import sys
import time

BETWEEN = {True: 0.2, False: 15.0}  # s between two lines: on a terminal, in a log
WIDTH = 78


class Progress:
    """One line that changes on a terminal, else a line now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet, self._tty = quiet, sys.stderr.isatty()
        self._stage, self._begun, self._first, self._last = "", 0.0, 0, 0.0

    def __call__(self, stage: str, count: int, of: int, said: str) -> None:
        """Say that a stage has done `count` of its steps, and something about it."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._begun, self._first, self._last = stage, now, count, 0.0
        if self._quiet or (count < of and now - self._last < BETWEEN[self._tty]):
            return
        self._last = now
        done = count - self._first
        left = "" if not done else f", {duration((of - count) * (now - self._begun) / done)} left"
        text = f"{stage} {count}/{of}, {said}{left}"[:WIDTH]
        print(f"\r{text:<{WIDTH}}" if self._tty else text, end="" if self._tty else "\n", file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line."""
        if self._tty and self._stage and not self._quiet:
            print(f"\r{'':<{WIDTH}}\r", end="", file=sys.stderr, flush=True)
        self._stage = ""


def duration(seconds: float) -> str:
    """Seconds, as a person says them."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"
