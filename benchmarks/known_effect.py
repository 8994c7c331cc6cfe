"""Joints and intervals of a single hidden effect whose name is given: the joints found, and the intervals' coverage.

    python -m benchmarks.known_effect [--set main|independent|independent_teleoperation] [--seeds test|development] [--cases 40]
                                      [--skip 0] [--jobs 2] [--shard I/N] [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]

The single effects of a set of benchmarks.diagnosis. The true effect is fitted as in a diagnosis, on the joints that
screening keeps; then its joints are selected and the intervals computed. A case counts as fitted if every joint's chi2
on the training recordings is at most twice the 95 % quantile of faultless robots.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.cases import case_options, one_sentence, run_cases, save_results
from benchmarks.diagnosis import FOLDER, Work, cases_of
from benchmarks.diagnosis_cases import SEEDS, Label, draw, labels
from benchmarks.diagnosis_figures import held, right_joints, share
from benchmarks.independent.cases import IndependentCase
from embodiedreamer_gym.diagnosis.candidates import polish, refit, single_trial
from embodiedreamer_gym.diagnosis.joint_selection import select_joints
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.diagnosis.screening import linearise, screen_effect
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import Case
from embodiedreamer_gym.standin.labels import places

SETS = ("main", "independent", "independent_teleoperation")

KEPT = ("index", "found", "servo", "fitted", "rollouts", "failed")  # keys kept in result.json
FITTED = 2.0  # limit for the worst joint: chi2 relative to the 95 % quantile of faultless robots


def known_effect(name: str, seeds: str, label: Label) -> dict[str, Any]:
    """Fit the hidden effect of a case, select its joints and compute intervals; the row also has the ground truth."""
    row: dict[str, Any] = {"index": label.index, "label": asdict(label)}
    try:
        case = draw(name, seeds, label)
        row["label"] |= {"values": case.hidden, "joints": places(case.hidden)}
        with tempfile.TemporaryDirectory() as folder:
            model = RobotModel.load(case.write(folder))
            train, test = (load_recordings(f"{folder}/{part}") for part in ("train", "test"))
        kind = CATALOGUE[label.effects[0]]
        problem, fit = fit_least_squares(model, train)
        calibrated = finish(problem, fit, 0.0).model
        null = draw_null(calibrated, fit, problem, test, np.random.default_rng(0))
        short, points = linearise(problem, fit, model)
        screened = screen_effect(kind, points, short, np.sqrt(np.median(null.chi2, axis=0)))
        begun = time.process_time()
        first = polish(refit(single_trial(calibrated, screened, problem.hold, False), train, test), test)
        seconds = [time.process_time() - begun]
        chosen = select_joints(first, train, test)
        seconds.append(time.process_time() - begun - sum(seconds))
        best = polish(chosen, test)
        wider = fit_with_robot_errors(best.problem, best.fit.x, [*train, *test])
        seconds.append(time.process_time() - begun - sum(seconds))
        found = finish(best.problem, best.fit, 0.0, wider).model.parameters()
        worst = best.problem.joint_rms(best.fit.residuals)[0] ** 2 / np.quantile(null.chi2, 0.95, axis=0)
        said: dict[str, Any] = {}
        for r in found.of_effect(kind.name):
            low, high = r.interval or (None, None)
            said[f"{r.key.place}.{r.key.parameter}"] = {"parameter": r.key.parameter, "value": r.value, "low": low, "high": high}  # fmt: skip
        gains = true_gains(case)
        servo = [bool(r.interval[0] <= gains[r.key.parameter][r.index] <= r.interval[1])
                 for r in found.select("stiffness", "damping") if r.interval]  # fmt: skip
        at = sorted({key.split(".")[0] for key in said})
        row |= {"found": {"joints": {kind.name: at}, "parameters": {kind.name: said}}, "servo": servo, "stages": seconds,
                "fitted": bool(worst.max() <= FITTED), "rollouts": chosen.rollouts - first.rollouts}  # fmt: skip
    except Exception as error:  # recorded in the row
        row["failed"] = f"{type(error).__name__}: {error}"
    return row


def true_gains(case: Case | IndependentCase) -> Mapping[str, Sequence[float]]:
    """Stiffness and damping of a case's servo, by joint."""
    if isinstance(case, Case):
        return case.truth["servo"]
    return {"stiffness": case.robot.stiffness.tolist(), "damping": case.robot.damping.tolist()}


def shown(row: dict[str, Any]) -> str:
    """A finished case as one line."""
    found = row.get("found", {}).get("joints", row.get("failed"))
    return f"{row['index']} {row['label']['effects'][0]} found {found} true {row['label'].get('joints')}"


def report(rows: Sequence[dict[str, Any]]) -> str:
    """Shares for all cases, and for the fitted ones."""
    lines = [f"failed: case {row['index']}, {row['failed']}" for row in rows if "failed" in row]
    rows = [row for row in rows if "failed" not in row]
    for title, some in (("all cases", rows), ("fitted cases", [row for row in rows if row["fitted"]])):
        lines += ["", f"{title}: {len(some)}"]
        figures = share("joints", map(right_joints, some), {}) + share("held", (i for r in some for i in held(r)), {})
        lines += [str(figure) for figure in figures]
        lines += [f"of the servo's gains: {f.hits} of {f.of}, {100 * f.value:.0f} % [{100 * f.low:.0f}, {100 * f.high:.0f}]"
                  for f in share("held", (i for row in some for i in row["servo"]), {})]  # fmt: skip
    seconds = np.median([row["stages"] for row in rows], axis=0)
    return "\n".join(
        [*lines, "", "CPU seconds of refit, selection, intervals, median: " + ", ".join(f"{s:.1f}" for s in seconds)]
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that are missing, then print the shares."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.known_effect", description=str(__doc__).splitlines()[0])
    parser.add_argument("--set", choices=SETS, default="main")
    parser.add_argument("--seeds", choices=SEEDS, default="test")
    parser.add_argument("--cases", type=int, default=40, help="number of single effects")
    parser.add_argument("--skip", type=int, default=0, help="number of cases to skip at the start")
    case_options(parser, FOLDER / "known-effect-SET-SEEDS.jsonl")
    a = parser.parse_args(arguments)
    out = a.out or FOLDER / f"known-effect-{a.set}-{a.seeds}.jsonl"
    wanted = [label for label in labels(a.set, a.seeds) if label.kind == "single"][a.skip : a.skip + a.cases]
    cases = cases_of(a.set, a.seeds, wanted)
    with one_sentence():
        rows = run_cases(a, cases, Work(known_effect, a.set, a.seeds), out, a.rows, shown)
    print(f"\n{report(rows)}")
    kept = [{key: row[key] for key in KEPT if key in row} | {"hidden": row["label"]["effects"]} for row in rows]
    save_results(a, cases, rows, a.seeds, {"rows": kept})


if __name__ == "__main__":
    main()
