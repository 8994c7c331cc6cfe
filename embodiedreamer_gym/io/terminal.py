"""What verbs read and say: counts among the options, and a line on stderr that says how far long work is."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from embodiedreamer_gym.errors import EmbodieDreamerError

WIDTH = 78


def count(text: str) -> int:
    """An option's whole number of at least 1, as argparse's type.

    Raises: ArgumentTypeError for less, ValueError for what is no whole number.
    """
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a count of at least 1")
    return value


def check_counts(options: argparse.Namespace, *names: str, least: int = 1) -> None:
    """Raises: EmbodieDreamerError that names the first of these options that is less."""
    for name in names:
        if getattr(options, name) < least:
            raise EmbodieDreamerError(f"--{name} is {getattr(options, name)}, but must be at least {least}.")


def check_places(*paths: Path | None, folders: bool = False) -> None:
    """Check that files, or folders, can be written where these options say, before long work begins; None is left out.

    Raises: EmbodieDreamerError for a folder in place of a file, or a file in place of a folder, and for a file's folder that
    is not there.
    """
    for path in (path.absolute() for path in paths if path is not None):
        there = next(one for one in (path, *path.parents) if one.exists())
        if not there.is_dir() and (folders or there != path):
            raise EmbodieDreamerError(f"{path} cannot be a folder: {there} is a file; give another place.")
        if not folders and path.is_dir():
            raise EmbodieDreamerError(f"{path} is a folder; name a file.")
        if not folders and not path.parent.is_dir():
            raise EmbodieDreamerError(f"folder {path.parent} does not exist; make it first.")


class StatusLine:
    """One line on stderr that changes, on a terminal; else a line now and then."""

    def __init__(self, quiet: bool = False, between: tuple[float, float] = (0.2, 15.0)) -> None:
        """Between: seconds from one line to the next on a terminal, and in a log."""
        self._quiet, self._tty = quiet, sys.stderr.isatty()
        self._between, self._last, self._open = between[not self._tty], -float("inf"), False

    def say(self, text: str, now: bool = False, last: bool = False) -> None:
        """Show a text, unless one was shown a moment ago and this one has not to be shown now; last: end the line."""
        here = time.monotonic()
        if self._quiet or (here - self._last < self._between and not now and not last):
            return
        self._last, self._open = here, not last
        line, end = (f"\r{text[:WIDTH]:<{WIDTH}}", "\n" if last else "") if self._tty else (text, "\n")
        print(line, end=end, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the line, where one is open."""
        if self._tty and self._open:
            print(f"\r{'':<{WIDTH}}\r", end="", file=sys.stderr, flush=True)
        self._open = False
