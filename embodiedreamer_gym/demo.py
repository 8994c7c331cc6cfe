"""The demo: from recordings of an arm with a hidden effect to a model that has the effect."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path

from embodiedreamer_gym.diagnosis import Comparison, Diagnosis, compare, diagnose, error_breakdown
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import write_json
from embodiedreamer_gym.io.progress import Progress
from embodiedreamer_gym.io.tables import layout, number
from embodiedreamer_gym.phys_aligner import calibrate
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel

DATA = Path(str(resources.files("embodiedreamer_gym") / "assets" / "demo"))
TRUTH = DATA / "truth.json"  # the ground truth; the diagnosis does not read it
BAR = 48  # characters of the bar for the largest error

INTRODUCTION = """\
A six-joint arm was recorded for 16 s: two motions for training, two held out for testing. Its model has
a URDF, servo gains as on a data sheet, and viscous friction. The arm has one more physical effect. (It is
simulated in another physics engine, MuJoCo, and has small errors of masses, gains and sensors too.)
"""


def run(folder: str | Path = "demo_report", progress: Progress | None = None) -> Path:
    """Compare, calibrate, diagnose, add an effect and compare again; prints each step and returns the report's path.

    folder: receives the model, the recordings, the better model and the report.
    Raises: EmbodieDreamerError when the folder cannot be written to.
    """
    folder, progress = Path(folder), progress or Progress(quiet=True)
    unpack(folder)
    model = RobotModel.load(folder / "model.json")
    train, test = load_recordings(folder / "train"), load_recordings(folder / "test")
    print(INTRODUCTION)

    before = compare(model, test)
    _print_step(1, "compare", f"the simulation is {_error(before)}")

    fit = calibrate(model, train, progress=progress)
    progress.close()
    calibrated = compare(fit.model, test)
    times = float(calibrated.error[0]) / calibrated.noise
    _print_step(2, "calibrate", f"now {_error(calibrated)}")
    print(f"         {fit.rollouts} rollouts, and still {times:.1f} times the noise: no servo gain explains this.")

    diagnosis = diagnose(model, train, test, jobs=os.cpu_count() or 1, progress=progress)
    progress.close()
    tried = f"{len(diagnosis.ranking)} of {len(model.catalogue)} effects refitted"
    _print_step(3, "diagnose", f"{tried}, {diagnosis.rollouts} rollouts, {diagnosis.seconds:.0f} s")
    print(_indent(_ranking(diagnosis)))
    print(f"         {diagnosis.sentence}")

    _print_step(4, "add", f"{' and '.join(diagnosis.effects) or 'nothing'}, everything fitted again")
    diagnosis.model.save(folder / "better.json")
    write_json(diagnosis.as_dict(), folder / "diagnosis.json")

    models = [diagnosis.nominal, diagnosis.calibrated, *([diagnosis.model] if diagnosis.effects else [])]
    _print_step(5, "compare again", "held-out error by joint, mrad")
    print(_indent(_joints(compare(models, test, labels=["nominal", "calibrated", "better"][: len(models)]))))
    print()
    print(_indent(_bars([*diagnosis.steps, ("sensor noise", diagnosis.error["noise"] or 0.0)])))
    from embodiedreamer_gym.diagnosis.report import write_report  # imports matplotlib

    page = write_report(
        folder, diagnosis=diagnosis, breakdown=error_breakdown(diagnosis.calibrated, test), recordings=test
    )

    print("\nThe ground truth:")
    print(_indent(_ground_truth(diagnosis, json.loads(TRUTH.read_text(encoding="utf-8")))))
    print(f"\nreport: {page}\nmodel:  {folder / 'better.json'}\n\nThe same on the command line:")
    inputs = f"--model {folder / 'model.json'} --train {folder / 'train'} --test {folder / 'test'}"
    print(f"  embodiedreamer diagnose {inputs} --report {folder}")
    return page


def unpack(folder: str | Path) -> Path:
    """Copy the demo's model, URDF and recordings (train/, test/) into a folder; returns the folder.

    Raises: EmbodieDreamerError when the folder cannot be written to.
    """
    folder = Path(folder)
    try:
        for source in sorted(DATA.rglob("*")):
            target = folder / source.relative_to(DATA)
            if source.is_file() and source != TRUTH:
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
    except OSError as error:
        raise EmbodieDreamerError(f"{folder} cannot be written: {error.strerror or error}.") from error
    return folder


def _print_step(step: int, verb: str, text: str) -> None:
    print(f"{step} of 5   {verb}: {text}", flush=True)


def _indent(text: str) -> str:
    return "\n".join(f"         {line}" for line in text.splitlines())


def _error(comparison: Comparison) -> str:
    error, noise, end = float(comparison.error[0]), comparison.noise, float(comparison.end_effector_mm[0])
    return f"{1e3 * error:.2f} mrad off ({end:.2f} mm at the tip); sensor noise is {1e3 * noise:.2f} mrad."


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [[r.effect, f"{r.held_out_chi2:.2f}"] for r in diagnosis.ranking]
    return layout(["with the effect", "held-out chi2/n (1 = noise)"], rows)


def _joints(comparison: Comparison) -> str:
    rows = []
    for j, joint in enumerate(comparison.joints):
        values = (*comparison.joint_rms[:, j], comparison.joint_noise[j])
        rows.append([joint, *(f"{1e3 * float(value):.2f}" for value in values)])
    return layout(["joint", *comparison.labels, "noise"], rows)


def _bars(steps: Sequence[tuple[str, float]]) -> str:
    """The errors (label, rad) as bars."""
    width = max(len(label) for label, _ in steps)
    longest = max(error for _, error in steps)
    return "\n".join(
        f"{label:<{width}} {1e3 * error:6.2f} mrad  {'#' * max(1, round(BAR * error / longest))}"
        for label, error in steps
    )


def _ground_truth(diagnosis: Diagnosis, truth: dict) -> str:
    """The hidden effect compared with the verdict, parameter by parameter."""
    named = ", ".join(diagnosis.effects) or diagnosis.verdict
    lines = [f"hidden: {truth['effect']}    diagnosed: {named}"]
    rows = list(_parameters(diagnosis, truth))
    if rows:
        lines.append(layout(["parameter", "truth", "estimate", "95 % interval", "unit"], rows))
    return "\n".join(lines)


def _parameters(diagnosis: Diagnosis, truth: dict) -> Iterator[list[str]]:
    hidden = {f"{truth['effect']}.{key}": values for key, values in truth["values"].items()}
    for row in diagnosis.model.parameters().of_effect(truth["effect"]):
        true = hidden.get(str(row.key.group), {}).get(row.key.place, row.off)
        interval = f"{number(row.interval[0])} .. {number(row.interval[1])}" if row.interval else "-"
        name = f"{row.key.parameter} of {row.key.place}"
        yield [name, number(true), number(row.value), interval, row.unit]
