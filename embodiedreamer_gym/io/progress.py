"""Progress of long work: the callable that functions report it to, and a line on stderr that shows it."""

from __future__ import annotations

import inspect
import time
import warnings
from typing import Any, Protocol

from embodiedreamer_gym.io.terminal import StatusLine


class ProgressCallback(Protocol):
    """Is called as long work advances, e.g. progress("screening effects", 7, 24, residual="1.45 chi2/n")."""

    def __call__(self, stage: str, done: int, total: int | None = None, /, **quantities: object) -> None:
        """Report progress.

        stage: what is being done.
        done: steps that are finished.
        total: number of steps, None where it is not known.
        quantities: named values as text with their units.
        """
        ...


class Progress:
    """One line that changes on a terminal, else a line now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._line = StatusLine(quiet, (0.1, 10.0))
        self._stage, self._begun = "", time.monotonic()

    def __call__(self, stage: str, done: int, total: int | float | None = None, /, **quantities: object) -> None:
        """Show the stage, its steps and the quantities; see `ProgressCallback`."""
        new, self._stage = stage != self._stage, stage
        if isinstance(total, float):  # a caller that reports one number without a name
            total, quantities = None, {"value": f"{total:.4g}", **quantities}
        steps = f"{done} of {total}" if total is not None else f"step {done}"
        values = [f"{name.replace('_', ' ')} {value}" for name, value in quantities.items()]
        self._line.say(", ".join([f"{time.monotonic() - self._begun:5.0f} s  {stage}: {steps}", *values]), now=new)

    def close(self) -> None:
        """Clear the line."""
        self._line.close()
        self._stage = ""


def silent(stage: str, done: int, total: int | None = None, /, **quantities: object) -> None:
    """Report nothing; see `ProgressCallback`."""


def progress_or_silence(progress: Any) -> ProgressCallback:
    """The callback itself, or `silent` for None.

    A callback of the former form (stage, step, value) gets the number of steps as its value, with a DeprecationWarning.
    """
    if progress is None:
        return silent
    try:
        inspect.signature(progress).bind("stage", 0, 1, value="")
    except TypeError:
        text = "progress is called as progress(stage, done, total, **quantities); take keyword arguments too"
        warnings.warn(text, DeprecationWarning, stacklevel=3)
        return lambda stage, done, total=None, /, **_: progress(stage, done, float(total or 0))
    return progress
