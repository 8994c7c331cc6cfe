"""Options of the verbs, declared as data, a line each; `command` gives them to argparse."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

REQUIRED: Any = ...
Option = tuple[str, dict[str, Any]]


def option(name: str, metavar: str | None, text: str, default: Any = None, kind: Any = str, **more: Any) -> Option:
    """An option, or an argument without dashes, for `ArgumentParser.add_argument`.

    metavar: None for a flag; default: REQUIRED where it must be given; one that is not empty is added to the text.
    kind: converts the text; more: nargs, choices, action, dest, const.
    """
    if default is not REQUIRED and default not in (None, [], "") and "default" not in text and metavar is not None:
        text += " (default: %(default)s)"
    settings: dict[str, Any] = {"help": text, **more}
    if metavar is None and "choices" not in more:
        settings["action"] = "store_true"
        return name, settings
    settings |= {"metavar": metavar, "type": kind}
    if name.startswith("-"):
        settings["required"] = default is REQUIRED
    if default is not REQUIRED:
        settings["default"] = default
    return name, settings


def whole(least: int, most: int) -> Callable[[str], int]:
    """A type of options: whole numbers of a range."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text} is not a whole number of {least} to {most}")
        return value

    return convert


def real(least: float, most: float = 1e9, above: bool = False) -> Callable[[str], float]:
    """A type of options: numbers of a range; above: `least` itself is not allowed."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most or (above and value == least):
            raise argparse.ArgumentTypeError(
                f"{text} is not a number {'above' if above else 'of'} {least:g} to {most:g}"
            )
        return value

    return convert


COUNT, POSITIVE = whole(1, 10**9), real(0.0, above=True)
CORES = os.cpu_count() or 1
REC = "files, folders, quoted globs"
MODEL = "JSON file or built-in robot (`embodiedreamer robots`)"
RECORDINGS = option("recordings", "REC", REC, REQUIRED, nargs="+")
SEED = option("--seed", "N", "of all that is drawn", 0, whole(0, 2**32 - 1))
QUIET = option("--quiet", None, "no progress")
JOBS = option("--jobs", "N", "processes", 1, whole(1, max(64, 4 * CORES)))
ALL_JOBS = option("--jobs", "N", "processes (default: one per core)", CORES, whole(1, max(64, 4 * CORES)))
ROBOT = option("--robot", "M", MODEL, "aloha")
HZ = option("--hz", "HZ", "samples per second of logs without time stamps", None, POSITIVE)
TIME_UNIT = option(
    "--time-unit", None, "of the logs' time stamps (default: found from the log)", None, choices=("s", "ms", "us", "ns")
)
SIZE = option("--size", "WxH", "of the pictures", "128x96")
TASK = option("--task", "TASK", "such as PutCupOnMat-v0", REQUIRED)
JSON = option("--json", "FILE", "write the result as JSON", None, Path)
BANK = option("--bank", "B", "photos that the video model starts from: lab, or a file", "lab")
VIS_ALIGNER = option(
    "--vis-aligner", "ALIGNER", "observe through the video model (default: lean)", None, nargs="?", const="lean"
)
EXECUTE = option("--execute", "K", "actions executed of each chunk (default: all)", None, COUNT)
LOGS = (
    option("--effects", "FILE.py", "your own effects; the file is executed"),
    HZ,
    TIME_UNIT,
    option("--hold", None, "how the controller reaches the next command", choices=("linear", "hold")),
    SEED,
    ALL_JOBS,
    QUIET,
    JSON,
    option("--report", "DIR", "write the result as a page, DIR/index.html", None, Path),
)
SPLIT = tuple(option(name, "REC", REC, REQUIRED, nargs="+") for name in ("--train", "--test"))


def out_file(kind: str, text: str, default: Any = REQUIRED) -> Option:
    """The option --out for a file."""
    return option("--out", kind, text, default, Path)


def out_folder(text: str, default: Any = REQUIRED) -> Option:
    """The option --out for a folder."""
    return option("--out", "DIR", text, default, Path)
