"""Run a case in its own process, with limits of time and memory."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import NoReturn

from benchmarks.fuzzing.case import VERDICTS, Case, Found, Result

ADDRESSES = 16 << 30  # bytes of address space beyond the parent's, so that an absurd allocation fails at once
LARGEST_FILE = 1 << 30  # bytes
# resident bytes of the forked process at its start: fewer than the parent's, because file pages are missing
BASELINE = "baseline.txt"


@dataclass
class Limits:
    """Limits of a case; seconds: wall-clock time without waiting for a processor; memory: growth in bytes."""

    seconds: float = 10.0
    memory: int = 2 << 30


class Running:
    """A forked process with one case; `poll` returns its result when it has ended or was killed."""

    def __init__(
        self, target: str, number: int, seed: int, run: Callable[[Case], None], seeds: Path, work: Path, limits: Limits
    ) -> None:
        self.target, self.number, self._limits = target, number, limits
        self.folder = work / f"{target}-{number}"
        self.folder.mkdir()
        self._begun, self._scanned = time.monotonic(), 0.0
        self._grown, self._killed = 0, ""
        sys.stdout.flush(), sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            _child(
                lambda: run(Case(self.folder, seeds, Random(f"{seed}:{target}:{number}"), number)), self.folder, limits
            )

    def poll(self) -> Result | None:
        """The result, or None while the case runs; kills a process that exceeds the limits."""
        pid, status, usage = os.wait4(self.pid, os.WNOHANG)
        now = time.monotonic()
        if pid == 0:
            self._measure(_memory(self.pid, "VmHWM"))
            waited = _waited(self.pid)
            if self._grown > self._limits.memory:
                self._kill("memory")
            elif now - self._begun - waited > self._limits.seconds or now - self._begun > 12 * self._limits.seconds:
                self._kill("hang")
            elif now - self._scanned > 1.0:
                self._scanned = now
                if len(_group(self.pid)) > 32:
                    self._kill("memory")
            return None
        with contextlib.suppress(OSError):
            os.killpg(self.pid, signal.SIGKILL)  # its remaining child processes
        self._measure(usage.ru_maxrss * 1024)  # peak of its whole life, even if rarely polled
        return self._result(status, now - self._begun)

    def _measure(self, peak: int) -> None:
        """Record by how much a peak of resident bytes exceeds the value at the process's start."""
        with contextlib.suppress(OSError, ValueError):  # the file does not exist yet
            self._grown = max(self._grown, peak - int((self.folder / BASELINE).read_text()))

    def _kill(self, verdict: str) -> None:
        self._killed = self._killed or verdict
        with contextlib.suppress(OSError):
            os.killpg(self.pid, signal.SIGKILL)

    def _result(self, status: int, seconds: float) -> Result:
        found: list[Found] = []
        with contextlib.suppress(OSError, ValueError):
            found = [Found(**one) for one in json.loads((self.folder / "found.json").read_text())]
        if self._killed or status != 0:
            text = _tail(self.folder / "hang.txt") if self._killed == "hang" else _tail(self.folder / "stderr.txt")
            ended = (
                f"killed after {seconds:.0f} s, {self._grown / 2**20:.0f} MB more"
                if self._killed
                else f"wait status {status}"
            )
            found.append(Found("?", self._killed or "dead", f"{ended}: {text}", _innermost(text)))
        elif self._grown > self._limits.memory:
            found.append(Found("?", "memory", f"{self._grown / 2**20:.0f} MB more", "?"))
        verdict = max((one.verdict for one in found), key=VERDICTS.index, default="ok")
        return Result(self.target, self.number, verdict, round(seconds, 3), round(self._grown / 2**20, 1), found)


def _child(run: Callable[[], None], folder: Path, limits: Limits) -> NoReturn:
    """Run a case in the forked process, with its own process group, streams and folder."""
    code = 1
    try:
        os.setpgid(0, 0)
        (folder / BASELINE).write_text(str(_memory(os.getpid(), "VmRSS")))
        for stream, name in ((1, "stdout.txt"), (2, "stderr.txt")):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False)  # noqa: SIM115
        hang = (folder / "hang.txt").open("w")
        faulthandler.enable(sys.stderr)
        faulthandler.dump_traceback_later(0.8 * limits.seconds, file=hang)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + ADDRESSES,) * 2)
        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.chdir(folder)
        run()
        (folder / "modules.json").write_text(json.dumps(sorted(sys.modules)))
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(code)


def _memory(pid: int, key: str) -> int:
    """Bytes from /proc/PID/status; key: VmRSS (resident) or VmHWM (peak since the fork); 0 if the process is gone."""
    try:
        return int(Path(f"/proc/{pid}/status").read_text().partition(f"{key}:")[2].split(maxsplit=1)[0]) * 1024
    except (OSError, IndexError, ValueError):
        return 0


def _waited(pid: int) -> float:
    """Seconds that a process waited for a processor, which do not count as a hang on a busy machine."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0


def _group(group: int) -> Sequence[int]:
    """Process ids of a process group."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            if int(path.read_text().rpartition(")")[2].split()[2]) == group:
                found.append(int(path.parent.name))
    return found


def _tail(path: Path) -> str:
    """The end of a traceback, without the list of extension modules that faulthandler prints after it."""
    with contextlib.suppress(OSError):
        return path.read_text("utf-8", "replace").partition("Extension modules:")[0][-3000:]
    return ""


def _innermost(text: str) -> str:
    """The innermost line of the package in a traceback printed by faulthandler."""
    lines = [line.strip() for line in text.splitlines() if "embodiedreamer_gym/" in line]
    return lines[0].rpartition("embodiedreamer_gym/")[2].replace('", line ', ":") if lines else "?"
