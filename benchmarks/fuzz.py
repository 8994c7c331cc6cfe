"""Fuzzing with mutated files, options and arguments: each must be accepted, or refused in one sentence.

python -m benchmarks.fuzz [--cases 10000] [--seed 0] [--targets csv,hdf5] [--jobs 2] [--shard I/N]
                          [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]
python -m benchmarks.fuzz --only csv:1234 --seed 0        one case again, with all its output

Tracebacks, hangs and half-written files are errors. A case depends only on target, seed and number. Finished cases are
kept in --out; a killed run continues from them. Each case is a forked process with limits: 10 s, and 2 GB more memory
than at its start.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from shutil import rmtree

from benchmarks.cases import case_options, one_sentence, read, save_results
from benchmarks.fuzzing.case import VERDICTS, Case, Found, Result
from benchmarks.fuzzing.process import Limits, Running
from embodiedreamer_gym.io.cases import Cases, Row
from embodiedreamer_gym.io.results import run_stamp

COLUMNS = {"ok": "ok", "refused": "refused", "unclear": "unclear", "half-written": "half-written", "traceback": "tracebacks",
           "memory": "> 2 GB", "hang": "hangs", "dead": "dead"}  # fmt: skip
WRONG = VERDICTS[2:]
SHOWN = 40  # most findings shown


def targets() -> dict[str, Callable[[Case], None]]:
    """All targets by name."""
    import benchmarks.fuzzing.learned  # noqa: F401  registers its targets
    from benchmarks.fuzzing.environments import environments
    from benchmarks.fuzzing.options import options
    from benchmarks.fuzzing.targets import TARGETS

    return {**TARGETS, "options": options, "environments": environments}


def plan(names: list[str], cases: int) -> list[tuple[str, int]]:
    """Target and number of each case; the targets alternate."""
    return [(names[k % len(names)], k // len(names)) for k in range(cases)]


def run(cases: Iterable[tuple[str, int]], seeds: Path, work: Path, seed: int = 0, jobs: int = 2, limits: Limits | None = None,
        known: dict[str, Callable[[Case], None]] | None = None, keep: bool = False) -> Iterator[Result]:  # fmt: skip
    """Results of cases as they end; jobs: cases at a time; keep: do not remove their folders."""
    known, waiting, going = known or targets(), iter(cases), list[Running]()
    while True:
        while len(going) < jobs and (case := next(waiting, None)) is not None:
            going.append(Running(*case, seed, known[case[0]], seeds, work, limits or Limits()))
        if not going:
            return
        for one in list(going):
            result = one.poll()
            if result is not None:
                going.remove(one)
                if not keep:
                    rmtree(one.folder, ignore_errors=True)
                yield result
        time.sleep(0.002)


def prepare(folder: Path, names: Iterable[str]) -> Path:
    """Write the seeds, and preload what cases need: imports, Numba compilations, an environment."""
    from benchmarks.fuzzing import environments
    from benchmarks.fuzzing.options import VERBS, offered
    from benchmarks.fuzzing.seeds import write_seeds

    seeds = folder / "seeds"
    seeds.mkdir()
    write_seeds(seeds)
    if "environments" in names:
        environments.warm()
    for verb in VERBS if "options" in names else ():
        offered(verb)
    check_seeds(folder, seeds, [name for name in names if name not in ("environments", "module", "options")])
    return seeds


def check_seeds(work: Path, seeds: Path, names: Iterable[str]) -> None:
    """Run each target on unmutated seeds, and import the modules that this loads, so that no case has to.

    Raises: SystemExit where a seed is refused.
    """
    first = Limits(seconds=600.0)  # includes compilation
    for result in run([(name, -1) for name in names], seeds, work, jobs=1, limits=first, keep=True):
        bad = [
            one for one in result.found if one.verdict != "ok" and "is not recognised in the pictures" not in one.error
        ]
        folder = work / f"{result.target}--1"
        if bad:
            raise SystemExit(f"the seed of {result.target} is refused: {bad[0].call}: {bad[0].error}")
        for module in json.loads((folder / "modules.json").read_text()):
            if module.partition(".")[0] not in ("__main__", "mine"):
                with suppress(ImportError):
                    importlib.import_module(module)
        rmtree(folder)


def table(results: Iterable[Result]) -> list[dict[str, object]]:
    """A row for each target, and one for all targets."""
    rows, every = [], list(results)
    for name in [*dict.fromkeys(sorted(one.target for one in every)), "all"]:
        mine = [one for one in every if name in (one.target, "all")]
        count = Counter(one.verdict for one in mine)
        times = sorted(one.seconds for one in mine)
        rows.append({"target": name, "cases": len(mine), **{title: count[verdict] for verdict, title in COLUMNS.items()},
                     "median ms": round(1000 * times[len(times) // 2]), "most MB": round(max(one.megabytes for one in mine))})  # fmt: skip
    return rows


def findings(results: Iterable[Result]) -> dict[tuple[str, str, str], list[tuple[Result, Found]]]:
    """Errors by target, verdict and place."""
    found: dict[tuple[str, str, str], list[tuple[Result, Found]]] = {}
    for result in results:
        for one in result.found:
            if one.verdict in WRONG:
                place = one.where if one.verdict in ("traceback", "memory", "hang", "dead") else one.error[:40]
                found.setdefault((result.target, one.verdict, place), []).append((result, one))
    return found


def shown(results: list[Result], seed: int) -> str:
    """The table as text, and the command that reproduces each finding."""
    rows = table(results)
    lines = [
        "  ".join(f"{title:>12}" for title in rows[0]),
        *("  ".join(f"{value!s:>12}" for value in row.values()) for row in rows),
    ]
    every = sorted(findings(results).items(), key=lambda item: -len(item[1]))
    for (target, verdict, place), found in every[:SHOWN]:
        result, one = found[0]
        error = " ".join(one.error.split())[:300]
        lines += ["", f"{len(found)} x {target}, {verdict} at {place or '?'}: {error}", f"    {one.call[:200]}",
                  f"    python -m benchmarks.fuzz --seed {seed} --only {target}:{result.number}"]  # fmt: skip
    if len(every) > SHOWN:
        lines.append(f"and {len(every) - SHOWN} more findings")
    return "\n".join(lines)


def result_of(row: Row) -> Result:
    """The result stored in a row."""
    data = {field.name: row[field.name] for field in fields(Result)}
    return Result(**data | {"found": [Found(**one) for one in row["found"]]})


def outcome(results: list[Result]) -> dict[str, object]:
    """Content of `result.json`: the table without times and memory, and the cases of each finding."""
    rows = [{key: value for key, value in row.items() if key not in ("median ms", "most MB")} for row in table(results)]
    found = [{"target": target, "verdict": verdict, "place": place, "cases": sorted({one.number for one, _ in each})}
             for (target, verdict, place), each in sorted(findings(results).items())]  # fmt: skip
    return {"table": rows, "findings": found}


def main(argv: list[str] | None = None) -> int:
    """Run the cases; returns 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cases", type=int, default=10_000, help="number of cases over all targets (default %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", help="names, separated by commas (default: all)")
    case_options(parser)
    parser.add_argument("--only", metavar="TARGET:NUMBER", help="run only this case and keep its folder")
    a = parser.parse_args(argv)
    os.environ.setdefault("MPLBACKEND", "Agg")
    os.environ.setdefault("BROWSER", "true")  # so that the workbench opens no browser
    known = targets()
    names = a.targets.split(",") if a.targets else list(known)
    single = [] if a.only is None else [(a.only.partition(":")[0], int(a.only.partition(":")[2] or 0))]
    for name in [*names, *(target for target, _ in single)]:
        if name not in known:
            parser.error(f"there is no target '{name}'; there are {', '.join(known)}")
    work = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        seeds = prepare(work, {target for target, _ in single} or names)
        if single:
            return _again(single[0], seeds, work, a.seed, known)
        with one_sentence():
            return _all(plan(names, a.cases), seeds, work, a, known)
    finally:
        if not single:
            rmtree(work, ignore_errors=True)


def _again(case: tuple[str, int], seeds: Path, work: Path, seed: int, known: dict[str, Callable[[Case], None]]) -> int:
    (result,) = run([case], seeds, work, seed, 1, known=known, keep=True)
    folder = work / f"{case[0]}-{case[1]}"
    print((folder / "stderr.txt").read_text(errors="replace"))
    print(json.dumps(asdict(result), indent=1), f"\nits folder: {folder}")
    return int(result.verdict in WRONG)


def _all(plan: list[tuple[str, int]], seeds: Path, work: Path, a: argparse.Namespace,
         known: dict[str, Callable[[Case], None]]) -> int:  # fmt: skip
    cases = Cases({"seed": a.seed}, [{"target": target, "number": number} for target, number in plan])
    missing = [(item["target"], item["number"]) for item in cases.missing(a.out, a.shard, a.rows)]
    rows = read(cases, a.out, a.rows)
    results = run(missing, seeds, work, a.seed, a.jobs, known=known)
    came = (({"target": one.target, "number": one.number}, {**asdict(one), "run": run_stamp()}) for one in results)
    begun, shown_at = time.monotonic(), 0.0
    for row in cases.record(a.out, came, len(missing)):
        rows.append(row)
        if time.monotonic() - shown_at > 5.0:
            shown_at, count = time.monotonic(), Counter(row["verdict"] for row in rows)
            wrong = ", ".join(f"{count[v]} {COLUMNS[v]}" for v in WRONG if count[v]) or "nothing wrong"
            print(f"{len(rows)} of {len(plan)} cases, {shown_at - begun:.0f} s: {wrong}", file=sys.stderr)
    if not rows:
        raise SystemExit("there is no case to run; give --cases of at least 1.")
    rows = cases.in_order(rows)
    found = [result_of(row) for row in rows]
    print(shown(found, a.seed))
    save_results(a, cases, rows, [a.seed], outcome(found))
    return int(any(one.verdict in WRONG for one in found))


if __name__ == "__main__":
    sys.exit(main())
