"""Servo firmware: diagnosis of firmware effects beyond spring and damper, and false alarms on plain servos.

python -m benchmarks.firmware [--cases N | --effects NAME ...] [--seeds test|development] [--jobs 2] [--shard I/N]
                              [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]

36 robots in another engine: two with each firmware effect, at two thirds to one and a half of its plain size, and 20
with plain spring-damper servos. Masses, gains and friction of all are wrong as in the benchmark `diagnosis`; this is
its set `firmware`. An effect of the same family counts as the right name. Finished cases are kept and not run again;
--cases runs the first N cases, --effects the cases of some effects ("none": plain servos).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from benchmarks.cases import case_options, one_sentence, run_cases, save_results
from benchmarks.common import clopper_pearson
from benchmarks.diagnosis import FOLDER, Work, cases_of, outcome, seal, shown
from benchmarks.diagnosis_cases import SEEDS, labels, run_case
from benchmarks.diagnosis_figures import accused, right_name, verdict
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.standin.effect_sizes import FIRMWARE

NAME, WANTED = "firmware", 0.85


def family(effect: str) -> str:
    """An effect's family, or its own name."""
    return CATALOGUE[effect].family or effect


def named(row: dict[str, Any]) -> bool:
    """Whether the named effect is the hidden one, or one of its family."""
    found, hidden = (
        {family(e) for e in effects} for effects in (row.get("found", {}).get("effects", ()), row["label"]["effects"])
    )
    return right_name(row) or (verdict(row) in ("missing", "ambiguous") and found == hidden)


def figures(rows: Sequence[dict[str, Any]]) -> str:
    """One line for each wrong case, and the shares."""
    hidden = [row for row in rows if row["label"]["effects"]]
    plain = [row for row in rows if not row["label"]["effects"]]
    right, wrong = [row for row in hidden if named(row)], [row for row in plain if accused(row)]
    lines = []
    for row in (r for r in rows if (r in hidden and r not in right) or r in wrong):
        said = row.get("failed") or ", ".join(row["found"]["effects"])
        lines.append(f"case {row['index']}: {', '.join(row['label']['effects']) or 'plain'} -> {verdict(row)} {said}")
    for what, part, whole in (("right name", right, hidden), ("false alarms on plain servos", wrong, plain)):
        if whole:
            low, high = clopper_pearson(len(part), len(whole))
            lines.append(f"{what}: {len(part)} of {len(whole)} (95 % interval {100 * low:.0f} to {100 * high:.0f} %)")
    if hidden:
        lines.append(f"targets: right name {'met' if len(right) >= WANTED * len(hidden) else 'MISSED'}, "
                     f"no false alarm {'MISSED' if wrong else 'met'}")  # fmt: skip
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that are missing, then print the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.firmware", description=str(__doc__).splitlines()[0])
    parser.add_argument("--cases", type=int, metavar="N", help="only the first N cases")
    parser.add_argument("--effects", nargs="+", choices=(*FIRMWARE, "none"), help="only the cases with these effects")
    parser.add_argument("--seeds", choices=SEEDS, default="test")
    case_options(parser, FOLDER / f"{NAME}-SEEDS.jsonl")
    a = parser.parse_args(arguments)
    out = a.out or FOLDER / f"{NAME}-{a.seeds}.jsonl"
    wanted = labels(NAME, a.seeds)[: a.cases]
    if a.effects:
        wanted = [label for label in wanted if set(a.effects) & set(label.effects or ("none",))]
    cases = cases_of(NAME, a.seeds, wanted)
    with one_sentence():
        seal(NAME, a.seeds, out.with_suffix(".labels.json"))
        rows = run_cases(a, cases, Work(run_case, NAME, a.seeds, oracle="none"), out, a.rows, shown, NAME)
    print(f"\n{figures(rows)}")
    save_results(a, cases, rows, a.seeds, outcome(rows, NAME))


if __name__ == "__main__":
    main()
