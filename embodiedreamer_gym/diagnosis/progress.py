"""Progress of long work on stderr."""

from __future__ import annotations

import sys
import time

BETWEEN = {True: 0.1, False: 10.0}  # s between two lines: on a terminal, in a log
WIDTH = 78


class Progress:
    """What is being done: one line that changes on a terminal, else a line now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet, self._tty = quiet, sys.stderr.isatty()
        self._stage, self._begun, self._last = "", time.monotonic(), 0.0

    def __call__(self, stage: str, count: int, value: float) -> None:
        """Say that a stage is at a step, with the value it lowers."""
        now = time.monotonic()
        if self._quiet or (stage == self._stage and now - self._last < BETWEEN[self._tty]):
            return
        self._stage, self._last = stage, now
        text = f"{now - self._begun:5.0f} s  {stage}, step {count}, {value:.4g}"[:WIDTH]
        line, end = (f"\r{text:<{WIDTH}}", "") if self._tty else (text, "\n")
        print(line, end=end, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the line."""
        if self._tty and self._stage:
            print(f"\r{'':<{WIDTH}}\r", end="", file=sys.stderr, flush=True)
            self._stage = ""
