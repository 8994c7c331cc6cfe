"""Progress of long work on stderr: how far it is, and how long it will take."""

from __future__ import annotations

import time

from embodiedreamer_gym.io.terminal import StatusLine


class Progress:
    """One line that changes on a terminal, else a line now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._line = StatusLine(quiet)
        self._stage, self._begun, self._first = "", 0.0, 0

    def __call__(self, stage: str, count: int, of: int, said: str) -> None:
        """Say that a stage has done `count` of its steps, and something about it."""
        now, new = time.monotonic(), stage != self._stage
        if new:
            self._stage, self._begun, self._first = stage, now, count
        done = count - self._first
        left = "" if not done else f", {duration((of - count) * (now - self._begun) / done)} left"
        self._line.say(f"{stage} {count}/{of}, {said}{left}", now=new or count >= of)

    def close(self) -> None:
        """End the line."""
        self._line.close()
        self._stage = ""


def duration(seconds: float) -> str:
    """Seconds, as a person says them."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"
