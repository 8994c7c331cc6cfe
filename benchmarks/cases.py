"""Functions shared by benchmarks that run lists of cases: options, finished rows, `result.json` and `run.json`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli.options import shard
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.cases import Cases, Row, Work
from embodiedreamer_gym.io.progress import duration
from embodiedreamer_gym.io.results import run_of, write_results
from embodiedreamer_gym.io.shard import Shard

COSTS = ("seconds", "run")  # keys of a row that result.json leaves out


def case_options(parser: argparse.ArgumentParser, out: Path | str | None = None, jobs: int = 2) -> None:
    """Add --jobs, --shard, --out, --rows and --results; out: default of --out."""
    default = "no file" if out is None else out
    parser.add_argument("--jobs", type=int, default=jobs, help="processes (default %(default)s)")
    parser.add_argument("--shard", type=shard, default=Shard(), metavar="I/N", help="only part I of N of the cases")
    parser.add_argument("--out", type=Path, metavar="FILE.jsonl", help=f"a row for each finished case, which is not run again (default: {default})")  # fmt: skip
    parser.add_argument("--rows", type=Path, nargs="*", default=[], metavar="FILE.jsonl", help="rows of other shards, which count as finished")  # fmt: skip
    parser.add_argument("--results", type=Path, metavar="DIR", help="write DIR/result.json and DIR/run.json")


@contextmanager
def one_sentence() -> Iterator[None]:
    """Print an error of the package as one sentence, and exit with 2."""
    try:
        yield
    except EmbodieDreamerError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from error


def read(cases: Cases, path: Path | None, also: Sequence[Path] = ()) -> list[Row]:
    """The rows of finished cases in a file, if it exists, and in further files, in the order of the list."""
    return cases.read(*([path] if path is not None and path.exists() else []), *also)


def run_cases(a: argparse.Namespace, cases: Cases, work: Work, path: Path | None, also: Sequence[Path],
              show: Callable[[Row], str], unit: str = "case") -> list[Row]:  # fmt: skip
    """Run the missing cases of the shard; print a line for each, with the estimated time left.

    path: file for the rows; None: they are not kept. also: further files of finished rows.
    Returns the rows of all finished cases, in the order of the list.
    Raises: EmbodieDreamerError where no case is finished, and as `Cases.run`.
    """
    begun, new, left = time.perf_counter(), list[Row](), len(cases.missing(path, a.shard, also))
    for row in cases.run(work, path, a.shard, a.jobs, also):
        new.append(row)
        remaining = (time.perf_counter() - begun) / len(new) * (left - len(new))
        print(
            f"{unit} {len(new):>3}/{left} {show(row)} {row['seconds']:4.0f} s, {duration(remaining)} left", flush=True
        )
    rows = read(cases, path, also) if path is not None else cases.in_order([*cases.read(*also), *new])
    if cases.each and not rows:
        raise EmbodieDreamerError(
            f"shard {a.shard} has none of the {len(cases.each)} cases, and no case of another shard is finished."
        )
    return rows


def save_results(
    a: argparse.Namespace, cases: Cases, rows: list[Row], seeds: Any, result: dict[str, Any], **times: float
) -> None:
    """Write the files of --results; result: content without times; times: further times for run.json."""
    if a.results is not None:
        whole = {
            "settings": dict(cases.settings),
            "cases": len(rows),
            "of": len(cases.keys),
            "cases_sha256": cases.sha256,
        }
        write_results(a.results, {**whole, **result}, {**run_of(rows), "seeds": seeds, "times": times})
