"""Progress of long work on stderr: stage, steps done and time left; at least one line every ten seconds."""

from __future__ import annotations

import inspect
import shutil
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable
from typing import Any, Protocol

SILENCE = 8.0  # seconds between lines in a log while the stage stays the same
REDRAW = (0.1, 1.0)  # seconds between redraws on a terminal: if the text changed, and if not
TICK = 0.1  # seconds between checks of the clock


class ProgressCallback(Protocol):
    """Called as long work advances, e.g. progress("screening effects", 7, 24, residual="1.45 chi2/n")."""

    def __call__(self, stage: str, done: int, total: int | None = None, /, **quantities: object) -> None:
        """Report progress.

        stage: name of the current work.
        done: number of finished steps.
        total: number of steps, None if it is not known.
        quantities: named values as text with their units.
        """
        ...


def silent(stage: str, done: int, total: int | None = None, /, **quantities: object) -> None:
    """Report nothing; see `ProgressCallback`."""


def progress_or_silence(progress: Any) -> ProgressCallback:
    """The callback itself, or `silent` for None.

    A callback of the old form (stage, step, value) receives `total` as its value, with a DeprecationWarning.
    """
    if progress is None:
        return silent
    try:
        inspect.signature(progress).bind("stage", 0, 1, value="")
    except TypeError:
        text = "progress is called as progress(stage, done, total, **quantities); accept keyword arguments too"
        warnings.warn(text, DeprecationWarning, stacklevel=3)
        return lambda stage, done, total=None, /, **_: progress(stage, done, float(total or 0))
    return progress


class Progress:
    """Show progress: one changing line on a terminal, separate lines in a log; a thread repeats it during long steps.

    quiet: show nothing.
    interrupted: returns whether the work must stop; if so, the next call raises KeyboardInterrupt.
    """

    def __init__(self, quiet: bool = False, interrupted: Callable[[], bool] = bool) -> None:
        self._quiet, self._terminal, self._interrupted = quiet, sys.stderr.isatty(), interrupted
        self._begun = self._stage_begun = time.monotonic()
        self._stage, self._text, self._first = "", "", 0
        self._last, self._urgent, self._shown, self._width = -float("inf"), False, "", 0
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None

    def __call__(self, stage: str, done: int = 0, total: int | None = None, /, **quantities: object) -> None:
        """Show the stage, its steps and the quantities; see `ProgressCallback`."""
        if self._interrupted():
            raise KeyboardInterrupt
        if self._quiet:
            return
        now = time.monotonic()
        with self._lock:
            if new := stage != self._stage:
                self._stage, self._stage_begun, self._first = stage, now, done
            self._text, self._urgent = (
                self._describe(done, total, quantities, now),
                self._urgent or new or done == total,
            )
        self._show()
        self._start()

    def starting(self, what: str, after: float = 1.0) -> None:
        """Show that work has started, unless it reports a stage or ends within `after` seconds."""
        if not self._quiet:
            self._text = f"{what}: starting"
            self._last = time.monotonic() - (REDRAW[self._text == self._shown] if self._terminal else SILENCE) + after
            self._start()

    def note(self, text: str) -> None:
        """Print a permanent line."""
        self.close()
        print(text, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Stop, and clear the line on a terminal; the next call starts again."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._stop.set()
            thread.join()
        if self._urgent and not self._terminal:
            self._last = -float("inf")
            self._show()
        with self._lock:
            if self._terminal and self._width:
                print(f"\r{'':<{self._width}}\r", end="", file=sys.stderr, flush=True)
            self._stage, self._shown, self._width, self._last, self._urgent = "", "", 0, -float("inf"), False

    def _start(self) -> None:
        if self._thread is None:
            self._stop.clear()
            self._thread = threading.Thread(target=_repeat, args=(weakref.ref(self), self._stop), daemon=True)
            self._thread.start()

    def _describe(self, done: int, total: int | None, quantities: dict[str, object], now: float) -> str:
        text = self._stage
        if total:
            text += f": {done} of {total} ({100 * done // total} %)"
        elif done:
            text += f": step {done}"
        text += "".join(f", {name.replace('_', ' ')} {value}" for name, value in quantities.items())
        steps = done - self._first
        if total and steps > 0 and done < total:
            text += f", {duration((total - done) * (now - self._stage_begun) / steps)} left"
        return text

    def _show(self) -> None:
        """Show the text if it is due."""
        with self._lock:
            now = time.monotonic()
            waited = now - self._last
            if self._terminal:
                due = waited >= REDRAW[self._text == self._shown]
            else:
                due = waited >= (REDRAW[1] if self._urgent else SILENCE)
            if not due:
                return
            line = f"{duration(now - self._begun):>6}  {self._text}"
            if self._terminal:
                line = line[: shutil.get_terminal_size().columns - 1]
                print(f"\r{line:<{self._width}}", end="", file=sys.stderr, flush=True)
            else:
                print(line, file=sys.stderr, flush=True)
            self._last, self._urgent, self._shown, self._width = now, False, self._text, len(line)


def _repeat(progress: weakref.ref[Progress], stop: threading.Event) -> None:
    """Show the text repeatedly, until the progress is closed or garbage-collected."""
    while not stop.wait(TICK):
        shown = progress()
        if shown is None:
            return
        shown._show()
        del shown


def duration(seconds: float) -> str:
    """A duration in s, min or h."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"
