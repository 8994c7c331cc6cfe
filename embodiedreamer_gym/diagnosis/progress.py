"""Progress of long work on stderr."""

from __future__ import annotations

import time

from embodiedreamer_gym.io.terminal import StatusLine


class Progress:
    """What is being done: one line that changes on a terminal, else a line now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._line = StatusLine(quiet, (0.1, 10.0))
        self._stage, self._begun = "", time.monotonic()

    def __call__(self, stage: str, count: int, value: float) -> None:
        """Say that a stage is at a step, with the value it lowers."""
        passed, new = time.monotonic() - self._begun, stage != self._stage
        self._stage = stage
        self._line.say(f"{passed:5.0f} s  {stage}, step {count}, {value:.4g}", now=new)

    def close(self) -> None:
        """Clear the line."""
        self._line.close()
        self._stage = ""
