"""Results as two files: `result.json`, byte-identical on every machine, and `run.json`, which records the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from embodiedreamer_gym.io.files import write_json

SOURCE = Path(__file__).parents[2]


def run_stamp() -> dict[str, str]:
    """Version of the package, its commit (if it runs from its repository), the machine, and the date in UTC."""
    return {**_place(), "date": datetime.now(UTC).date().isoformat()}


def installed_version() -> str:
    """Version of the package, or "not installed" where it runs from a checkout alone."""
    try:
        return version("embodiedreamer-gym")
    except PackageNotFoundError:
        return "not installed"


@cache
def _place() -> dict[str, str]:
    found = {"version": installed_version()}
    if (SOURCE / ".git").exists():
        command = ["git", "-C", str(SOURCE), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
        with suppress(OSError, subprocess.SubprocessError):
            found["commit"] = subprocess.run(
                command, capture_output=True, text=True, check=True, timeout=10
            ).stdout.strip()
    found["machine"] = f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}, Python {platform.python_version()}"  # fmt: skip
    return found


def _processor() -> str:
    """The processor's name."""
    with suppress(OSError, IndexError):
        return Path("/proc/cpuinfo").read_text().partition("model name")[2].split("\n")[0].split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def run_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Content of `run.json`: number of rows, sum of their seconds, distinct versions, commits, machines and dates."""
    rows = list(rows)
    stamps = [row.get("run") or {} for row in rows]
    found = {name: sorted({stamp[name] for stamp in stamps if name in stamp})
             for name in ("version", "commit", "machine", "date")}  # fmt: skip
    return {"cases": len(rows), "seconds": round(sum(row.get("seconds") or 0.0 for row in rows), 3), **found}


def write_results(folder: Path, result: Mapping[str, Any], run: Mapping[str, Any]) -> None:
    """Write `result.json` and `run.json` into a folder, which is created if it does not exist.

    result: JSON-serialisable, without times or anything else that differs between runs of the same cases. run: see
    `run_of`.
    Raises: EmbodieDreamerError when a file cannot be written; ValueError for a number that is not finite.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in (("result", result), ("run", run)):
        write_json(data, folder / f"{name}.json", sort_keys=True)
