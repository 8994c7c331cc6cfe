"""Blind diagnosis: `diagnose` on robots with zero, one or two hidden effects, simulated in another engine.

python -m benchmarks.diagnosis [--set main|positions|teleoperation|no_command|poor_urdf|other_arm|ties|firmware|independent|independent_teleoperation] [--seeds test|development]
                               [--cases N] [--oracle singles|all|none] [--brute N] [--beside MAIN.jsonl] [--figures-only]
                               [--jobs 2] [--shard I/N] [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]

main: 240 cases on a six-joint arm, logs of command, position and effort: 100 faultless robots (their masses, centres of
mass, gains and viscous friction are wrong, as in every case); 80 single effects, from barely visible to strong; 30
pairs of effects of different families; 30 effects removed from the catalogue that the diagnoser gets, except effects
whose law another effect contains. The variants have 80 cases each: positions (logs without effort); teleoperation at
30 Hz for both training and test; no_command (positions and efforts); poor_urdf (the same, with masses up to 10 % and
centres 10 mm off); other_arm (two other arms, the mixture of main, compared with main's figures); ties (slow,
uninformative motion and a user's question "this or that?"; then the proposed motion is recorded, the diagnosis
repeated, and the two effects are compared by likelihood). The torque constant is in no_command only: with a logged
command the fitted gains absorb it, so it is invisible. independent and independent_teleoperation come from another
generator, which shares no code with the package's stand-in (`benchmarks/independent`): three arms, 21 effects that
change the held-out logs by 3 to 60 sensor noises before any fit, and eight effects outside the catalogue.

Each case has four recordings of 6 s; two of them are held out and of another kind. The labels are written to
OUT.labels.json and their SHA-256 is printed before the first diagnosis; the diagnoser sees only recordings, a URDF and
nominal gains. Finished cases are kept, one JSON line each, and not run again; --shard and --rows share them between
jobs (docs/scaling.md). A case that raises an error counts as wrong. Thresholds are tuned on the development seeds only.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.cases import case_options, one_sentence, read, run_cases, save_results
from benchmarks.diagnosis_cases import SEEDS, SETS, Label, brute_case, labels, run_case, sealed
from benchmarks.diagnosis_figures import figures, report, right_name, verdict
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.cases import Cases, Row

FOLDER = Path("build") / "diagnosis"


def seal(name: str, seeds: str, path: Path) -> None:
    """Write the labels next to the rows, and print their SHA-256.

    Raises: EmbodieDreamerError where the file has other labels, so that the rows belong to other cases.
    """
    text = sealed(name, seeds)
    if path.is_file() and path.read_text() != text:
        raise EmbodieDreamerError(
            f"{path} contains the labels of other cases; give another --out, or move it and its rows away."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    print(f"labels: {path}, SHA-256 {hashlib.sha256(text.encode()).hexdigest()}", flush=True)


def cases_of(name: str, seeds: str, wanted: Sequence[Label]) -> Cases:
    """The list of cases for labels of a set."""
    digest = hashlib.sha256(sealed(name, seeds).encode()).hexdigest()
    settings = {"set": name, "seeds": seeds, "labels_sha256": digest}
    return Cases(settings, [{"index": label.index} for label in wanted])


class Work:
    """A function such as `run_case` or `brute_case`, called with a label's index as the case."""

    def __init__(self, run: Callable[..., dict[str, Any]], name: str, seeds: str, **options: Any) -> None:
        self.run, self.name, self.seeds, self.options = run, name, seeds, options

    def __call__(self, case: Mapping[str, Any]) -> dict[str, Any]:
        label = labels(self.name, self.seeds)[case["index"]]
        return self.run(self.name, self.seeds, label, **self.options)


def shown(row: Row) -> str:
    """A finished case as one line: ground truth and verdict."""
    truth = " + ".join(row["label"]["effects"]) or "faultless"
    said = row.get("named") or row.get("failed") or ""
    if "found" in row:
        said = f"{'+ ' if right_name(row) else ''}{verdict(row)} {', '.join(row['found']['effects'])}"
    return f"case {row['index']:<4}{row['label']['kind']:<8} {truth:<44} {said:<52}"


def outcome(rows: Sequence[Row], name: str) -> dict[str, Any]:
    """Content of `result.json`: the figures without times, and the verdict of each case."""
    cases = [{"index": row["index"], "kind": row["label"]["kind"], "hidden": list(row["label"]["effects"]), "verdict": verdict(row),
              "named": row.get("found", {}).get("effects", []), "failed": row.get("failed", "")} for row in rows]  # fmt: skip
    found = [{**asdict(figure), "met": figure.met} for figure in figures(rows, name) if "seconds" not in figure.key]
    return {
        "rows": cases,
        "figures": [{key: value for key, value in figure.items() if key != "target"} for figure in found],
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that are missing, then print the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis", description=str(__doc__).splitlines()[0])
    parser.add_argument("--set", choices=SETS, default="main")
    parser.add_argument("--seeds", choices=SEEDS, default="test")
    parser.add_argument("--cases", type=int, help="only the first N cases, a mixture of all kinds")
    parser.add_argument("--oracle", choices=("none", "singles", "all"), default="singles",
                        help="cases that are refitted with the true effects as well, to compare held-out errors")  # fmt: skip
    parser.add_argument(
        "--brute", type=int, default=0, metavar="N", help="run the baseline on the first N singles and nulls"
    )
    parser.add_argument("--beside", type=Path, help="rows of main, to compare other_arm with")
    parser.add_argument("--figures-only", action="store_true")
    case_options(parser, FOLDER / "SET-SEEDS.jsonl")
    a = parser.parse_args(arguments)
    out = a.out or FOLDER / f"{a.set}-{a.seeds}.jsonl"
    brute_out = out.with_suffix(".brute.jsonl")
    wanted = labels(a.set, a.seeds)[: a.cases]
    cases = cases_of(a.set, a.seeds, wanted)
    plain = cases_of(a.set, a.seeds, [label for label in wanted if label.kind in ("single", "null")][: a.brute])
    brute_also = [path for path in (one.with_suffix(".brute.jsonl") for one in a.rows) if path.exists()]
    with one_sentence():
        if not a.figures_only:
            seal(a.set, a.seeds, out.with_suffix(".labels.json"))
            run_cases(a, cases, Work(run_case, a.set, a.seeds, oracle=a.oracle), out, a.rows, shown, "diagnose")
            run_cases(a, plain, Work(brute_case, a.set, a.seeds), brute_out, brute_also, shown, "brute")
        rows, brute = read(cases, out, a.rows), read(plain, brute_out, brute_also)
        beside = cases_of("main", a.seeds, labels("main", a.seeds)).read(a.beside) if a.beside else ()
    if not rows:
        parser.error(f"{out} contains no finished case.")
    print(f"\n{report(rows, a.set, beside, brute)}")
    print(f"\nseconds are for one diagnosis on one thread; with --jobs {a.jobs}, as many ran in parallel.")
    times = {figure.key: figure.value for figure in figures(rows, a.set) if "seconds" in figure.key}
    save_results(a, cases, rows, a.seeds, outcome(rows, a.set), **times)


if __name__ == "__main__":
    main()
