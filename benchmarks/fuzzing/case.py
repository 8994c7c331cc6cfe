"""One case: its calls, and the result of each call."""

from __future__ import annotations

import json
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.fuzzing.files import mutate

VERDICTS = (
    "ok",
    "refused",
    "unclear",
    "half-written",
    "traceback",
    "memory",
    "hang",
    "dead",
)  # ordered; the worst one of a case counts
PATIENCE = 3.0  # s after which a running command is interrupted, as a user would do


@dataclass
class Found:
    """Result of one call; where: innermost line of the package in the traceback."""

    call: str
    verdict: str
    error: str = ""
    where: str = ""


@dataclass
class Result:
    """Result of a case: worst verdict of its calls, wall-clock seconds, and growth of memory in MB."""

    target: str
    number: int
    verdict: str
    seconds: float
    megabytes: float
    found: list[Found] = field(default_factory=list)


class Case:
    """Tools for a target: its own folder for copies of seeds, and calls whose results are recorded."""

    def __init__(self, folder: Path, seeds: Path, rng: Random, number: int) -> None:
        self.folder, self.seeds, self.rng, self.number = folder, seeds, rng, number
        self.out = folder / "out"
        self.out.mkdir()
        self.found: list[Found] = []
        self.names: set[str] = set()  # error messages must contain one of these
        self._log = sys.stderr

    def copy(self, name: str) -> Path:
        """Copy a seed into the case's folder."""
        source, path = self.seeds / name, self.folder / name
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, path)
        return path

    def mutate(self, path: Path) -> Path:
        """Mutate a file, or a file of a folder (case -1: change nothing); returns the mutated path."""
        return path if self.number < 0 else mutate(path, self.rng)

    def about(self, *paths: Path) -> None:
        """Add files that error messages must name, by stem or folder."""
        self.names |= {text for path in paths for text in (path.stem, path.parent.name) if text}

    def library(self, what: str, call: Callable[[], Any], allowed: tuple[type[Exception], ...] = ()) -> bool:
        """Make a call that may raise the package's errors or those allowed; returns whether it raised none."""
        from embodiedreamer_gym.errors import EmbodieDreamerError

        try:
            call()
        except (EmbodieDreamerError, *allowed) as error:
            self._note(what, self._clear(str(error)), f"{type(error).__name__}: {error}")
            return False
        except Exception as error:
            self._wrong(what, error)
            return False
        self._note(what, "ok")
        return True

    def command(self, *argv: object, patience: float = PATIENCE) -> None:
        """Run the command; it must exit with 0, with 2 and one line "error: ...", or with 130 when interrupted."""
        from embodiedreamer_gym.cli import main

        words = [str(a) for a in argv]
        what, before = " ".join(["embodiedreamer", *words])[:400], self._listed()
        start = self._position()
        signal.signal(signal.SIGALRM, lambda number, frame: signal.raise_signal(signal.SIGINT))
        signal.setitimer(
            signal.ITIMER_REAL, 0 if self.number < 0 else patience
        )  # a seed's run includes compilation for all cases
        try:
            code = main(words)
        except SystemExit as end:  # --help
            code = 2 if isinstance(end.code, str) else int(end.code or 0)
        except KeyboardInterrupt:
            return self._note(what, "traceback", "KeyboardInterrupt came through main", "cli")
        except BaseException as error:
            return self._wrong(what, error)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        errors = [line for line in self._since(start).splitlines() if line.startswith("error:")]
        left = sorted(self._listed() - before)
        if code == 0 or code == 130:
            self._note(what, "ok")
        elif code != 2 or len(errors) != 1:
            self._note(what, "unclear", f"exit code {code}, {len(errors)} lines that begin with error:", "cli")
        else:
            self._note(what, self._clear(errors[0]), errors[0])
        parts = [name for name in left if ".part" in name or (code == 2 and not name.startswith("in"))]
        if code and parts:
            self._note(
                what,
                "half-written",
                f"exit code {code} left {', '.join(parts[:3])} ({'; '.join(errors)[:300]})",
                ", ".join(parts[:1]),
            )

    def check(self, what: str, good: bool) -> None:
        """Record a failure if a condition does not hold."""
        if not good:
            self._note(what, "traceback", f"does not hold: {what}", what)

    def _clear(self, text: str) -> str:
        """Verdict on a refusal: "refused" for one short line that names the damaged file, else "unclear"."""
        named = not self.names or any(name in text for name in self.names)
        return "refused" if named and "\n" not in text.strip() and 0 < len(text) < 2000 else "unclear"

    def _wrong(self, what: str, error: BaseException) -> None:
        frames = traceback.extract_tb(error.__traceback__)
        own = [f for f in frames if "embodiedreamer_gym" in f.filename] or frames[-1:]
        where = ", ".join(f"{f.filename.rpartition('embodiedreamer_gym/')[2]}:{f.lineno} {f.name}" for f in own[-1:])
        verdict = "memory" if isinstance(error, MemoryError) else "traceback"
        try:
            text = f"{type(error).__name__}: {error}"
        except Exception:
            text = type(error).__name__
        self._note(what, verdict, text, where)
        traceback.print_exception(error)

    def _note(self, what: str, verdict: str, error: str = "", where: str = "") -> None:
        clean = [text.encode("utf-8", "replace").decode()[:600] for text in (what, verdict, error, where)]
        self.found.append(Found(*clean))
        (self.folder / "found.json").write_text(json.dumps([asdict(one) for one in self.found]))

    def _listed(self) -> set[str]:
        return {
            str(path.relative_to(self.folder))
            for path in self.folder.rglob("*")
            if path.name not in ("found.json", "stderr.txt", "stdout.txt")
        }

    def _position(self) -> int:
        sys.stdout.flush(), sys.stderr.flush()
        return (self.folder / "stderr.txt").stat().st_size

    def _since(self, start: int) -> str:
        sys.stdout.flush(), sys.stderr.flush()
        return (self.folder / "stderr.txt").read_bytes()[start:].decode("utf-8", "replace")
