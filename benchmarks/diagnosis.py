"""Blind diagnosis: robots with none, one or two hidden effects, made in another engine; what `diagnose` says of them.

python -m benchmarks.diagnosis [--set main|positions|teleoperation|no_command|poor_urdf|other_arm|ties|firmware|independent|independent_teleoperation] [--seeds test|development]
                               [--cases N] [--jobs 2] [--oracle singles|all|none] [--brute N] [--out FILE.jsonl]
                               [--beside MAIN.jsonl] [--figures-only]

main: 240 cases on a six-joint arm, logs of command, position and effort: 100 faultless robots, whose masses, centres of
mass, gains and viscous friction are wrong as in every case; 80 single effects, from barely visible to strong; 30 pairs
of effects of different families; 30 effects left out of the catalogue that the diagnoser is given, other than those
whose law another member contains. The variants have 80 cases each: positions (and commands) alone; teleoperation at
30 Hz to learn from and to be judged by; no_command (positions and efforts); poor_urdf (the same, masses up to 10 % and centres 10 mm off); other_arm (two other arms, the mixture of
main, beside main's figures); ties (slow, poor motion on a user's question "this or that?", then the proposed motion is
recorded, everything is asked again, and the two are compared by their likelihood). A torque constant is in no_command only: with a logged command the gains take
it up, and nothing is left to see. independent and independent_teleoperation come from another generator that shares no code with
the package's stand-in (`benchmarks/independent`): three arms, 21 effects sized by what they change of the held-out logs, 3 to 60
sensor noises before anything is fitted, and eight effects outside the catalogue.

Four recordings of 6 s a case, two of them held out and of another kind. The labels are written to OUT.labels.json and
their SHA-256 printed before the first diagnosis; the diagnoser sees files of recordings, a URDF and nominal gains.
Finished cases are kept, one JSON line each, and not run again. A case that raises an error counts as wrong.
Thresholds are tuned on the development seeds only.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from benchmarks.common import pin_threads
from benchmarks.diagnosis_cases import SEEDS, SETS, Label, brute_case, labels, run_case, sealed
from benchmarks.diagnosis_figures import report, right_name, verdict

FOLDER = Path("build") / "diagnosis"


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Rows of finished cases; a torn last line is not one of them."""
    if not path.is_file():
        return []
    text = path.read_text()
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines() if line.strip()]


def seal(name: str, seeds: str, path: Path) -> str:
    """Write the labels beside the rows and return their SHA-256.

    Raises: ValueError where other labels are there already, so that the rows are of other cases.
    """
    text = sealed(name, seeds)
    if path.is_file() and path.read_text() != text:
        raise ValueError(f"{path} holds the labels of other cases; give another --out, or move it and its rows away.")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return hashlib.sha256(text.encode()).hexdigest()


def run_missing(
    wanted: Sequence[Label], work: Callable[[Label], dict[str, Any]], out: Path, jobs: int, stamp: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    """Run the cases that `out` does not hold yet, in processes of one thread; append each and yield it as it comes.

    Raises: ValueError where a row of `out` belongs to other labels.
    """
    rows = read_rows(out)
    if any(row.get("labels_sha256") != stamp["labels_sha256"] for row in rows):
        raise ValueError(f"{out} holds rows of other labels; give another --out, or move it away.")
    done = {row["index"] for row in rows}
    missing = [label for label in wanted if label.index not in done]
    with out.open("a+b") as file, parallel_config(backend="loky", inner_max_num_threads=1):
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)  # a torn last line
        for row in Parallel(n_jobs=jobs, return_as="generator_unordered")(delayed(work)(label) for label in missing):
            row = stamp | dict(row or {})
            file.write((json.dumps(row, default=_plain) + "\n").encode())
            file.flush()
            yield row


def _plain(value: Any) -> Any:
    """A numpy number or array as JSON has it."""
    return value.tolist()


class Case:
    """`run_case` or `brute_case` of a set, that a process can be sent."""

    def __init__(self, work: Callable[..., dict[str, Any]], name: str, seeds: str, **options: Any) -> None:
        self.work, self.name, self.seeds, self.options = work, name, seeds, options

    def __call__(self, label: Label) -> dict[str, Any]:
        return self.work(self.name, self.seeds, label, **self.options)


def show(rows: Iterator[dict[str, Any]], left: int, title: str) -> None:
    """A line per finished case, with the time that the others will take at this pace."""
    begun = time.perf_counter()
    for k, row in enumerate(rows, 1):
        remaining = (time.perf_counter() - begun) / k * (left - k) / 60
        truth = " + ".join(row["label"]["effects"]) or "faultless"
        said = row.get("named") or row.get("failed") or ""
        if "found" in row:
            said = f"{'+ ' if right_name(row) else ''}{verdict(row)} {', '.join(row['found']['effects'])}"
        print(f"{title} {k:>3}/{left} case {row['index']:<4}{row['label']['kind']:<8} {truth:<44} {said:<52} "
              f"{row['seconds']:4.0f} s, {remaining:.0f} min left", flush=True)  # fmt: skip


def run_all(a: argparse.Namespace, out: Path, brute_out: Path) -> None:
    """Seal the labels, then run what is missing of the cases and of the baseline."""
    digest = seal(a.set, a.seeds, out.with_suffix(".labels.json"))
    print(f"labels: {out.with_suffix('.labels.json')}, SHA-256 {digest}", flush=True)
    stamp = {"set": a.set, "seeds": a.seeds, "labels_sha256": digest}
    wanted = labels(a.set, a.seeds)[: a.cases]
    plain = [label for label in wanted if label.kind in ("single", "null")][: a.brute]
    works = [("diagnose", wanted, Case(run_case, a.set, a.seeds, oracle=a.oracle), out),
             ("brute", plain, Case(brute_case, a.set, a.seeds), brute_out)]  # fmt: skip
    for title, cases, work, path in works:
        left = {label.index for label in cases} - {row["index"] for row in read_rows(path)}
        if left:
            show(run_missing(cases, work, path, a.jobs, stamp), len(left), title)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that are missing, then print the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis", description=str(__doc__).splitlines()[0])
    parser.add_argument("--set", choices=SETS, default="main")
    parser.add_argument("--seeds", choices=SEEDS, default="test")
    parser.add_argument("--cases", type=int, help="only the first N cases, a mixture of all kinds")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--oracle", choices=("none", "singles", "all"), default="singles",
                        help="of which cases a refit with the true effects is made, to compare held-out errors")  # fmt: skip
    parser.add_argument(
        "--brute", type=int, default=0, metavar="N", help="the baseline on the first N singles and nulls"
    )
    parser.add_argument("--out", type=Path, help=f"default: {FOLDER}/SET-SEEDS.jsonl")
    parser.add_argument("--beside", type=Path, help="rows of main, to set other_arm beside")
    parser.add_argument("--figures-only", action="store_true")
    a = parser.parse_args(arguments)
    pin_threads()
    out = a.out or FOLDER / f"{a.set}-{a.seeds}.jsonl"
    brute_out = out.with_suffix(".brute.jsonl")
    if not a.figures_only:
        try:
            run_all(a, out, brute_out)
        except ValueError as error:
            parser.error(str(error))
    rows = [row for row in read_rows(out) if a.cases is None or row["index"] < a.cases]
    if not rows:
        parser.error(f"{out} holds no finished case.")
    brute = read_rows(brute_out)
    print(f"\n{report(rows, a.set, read_rows(a.beside) if a.beside else (), brute)}")
    print(f"\nseconds are of one diagnosis on one thread; --jobs {a.jobs} of them ran side by side.")


if __name__ == "__main__":
    main()
