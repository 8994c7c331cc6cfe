"""Hidden cases: the files for a tool in one folder, the ground truth in another.

A case is a robot drawn by `standin.cases`: recordings for fitting (train/), held-out recordings for testing (test/),
and motions whose signal is to be predicted (predict/), which is measured but withheld. Nothing in a case reveals its
tier.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.bench.task import Task, load_task, signal_of
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.engines.export import export_model
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import atomic_folder, write_json
from embodiedreamer_gym.io.parallel import ended_workers, many
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.recordings import Recording, Recordings, load_recordings, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import SENSOR, Case
from embodiedreamer_gym.standin.effect_sizes import PER_ARM
from embodiedreamer_gym.standin.labels import (
    AS_A_PERSON,
    IN_EFFORT,
    OUTSIDE,
    PLAIN,
    SINGLES,
    draw_at_rest,
    draw_strength,
    partners,
)
from embodiedreamer_gym.standin.robot import EFFORT_SCALE_ANGLE

FORMAT = 1
TIERS = ("none", "single", "subset", "pair", "outside")
OBSERVATIONS: dict[str, dict[str, Any]] = {
    "position": {"with_effort": False},
    "effort": {},
    "no_command": {"with_command": False},
    "teleoperation": {**AS_A_PERSON, "held_out": ("teleoperation",) * 4},
}
HELD_OUT = ("teleoperation", "slow_ramps") * 2  # the first two for testing, the others to predict
GIVEN = 2  # held-out recordings that a tool sees
VISIBLE = 1.0  # in units of sensor noise: least mean square change of the withheld signals by an effect
LEFT_OUT = 3  # effects missing from each case's list of names
ARM, SECONDS = "arm6", 6.0
README = """One folder per case; docs/bench.md describes how to answer.

model.json, arm.urdf, arm.xml   the nominal robot: this project's format, URDF, MJCF with servos
train/, test/                   recordings (csv): for training, and held out for testing
predict/                        motions to predict: csv without the signal that `case.json` names
case.json                       the names that an answer may use, joints, end effectors, where each motion to predict starts
"""


def make_cases(
    out: Path, truth: Path, count: int, seed: int = 0, tiers: Sequence[str] = TIERS,
    observations: Sequence[str] = tuple(OBSERVATIONS), real: Sequence[Path] = (), seconds: float = SECONDS, jobs: int = 1,
    progress: ProgressCallback | None = None,
) -> str:  # fmt: skip
    """Write cases into a new folder and their ground truth into another; return the SHA-256 of the truth.

    The SHA-256 is also written to the folder of the cases.

    real: folders with a model.json, train/ and test/, added as cases of the tier "real": only their error counts.
    seconds: of each recording.
    Raises: EmbodieDreamerError for an unknown tier or observation, and for a folder that is not empty or contains the
    other.
    """
    _check_choice("tier", tiers, TIERS)
    _check_choice("observation", observations, tuple(OBSERVATIONS))
    inside, outside = out.resolve(), truth.resolve()
    if inside == outside or inside in outside.parents or outside in inside.parents:
        raise EmbodieDreamerError(
            f"{truth} and {out} must be separate; give two folders that do not contain each other."
        )
    report = progress_or_silence(progress)
    with atomic_folder(out) as cases, atomic_folder(truth) as secret, ended_workers():
        cells = [(tiers[k % len(tiers)], observations[(k % len(tiers) + k // len(tiers)) % len(observations)], k)
                 for k in range(count)]  # fmt: skip
        calls = [(cases / "cases" / f"{k + 1:04}", secret, *cell, seed, seconds) for k, cell in enumerate(cells)]
        report("drawing cases", 0, count)
        rows = many(draw_task, calls, jobs, lambda done, _: report("drawing cases", done, count))
        for k, source in enumerate(real, count):
            rows.append(real_task(cases / "cases" / f"{k + 1:04}", secret, source))
        text = json.dumps({"format": FORMAT, "seed": seed, "cases": {row.pop("case"): row for row in rows}}, indent=1)
        digest = hashlib.sha256(text.encode()).hexdigest()
        (secret / "truth.json").write_text(text)
        write_json({"format": FORMAT, "truth_sha256": digest, "cases": len(rows)}, cases / "bench.json")
        (cases / "README.txt").write_text(README)
    return digest


def _check_choice(what: str, given: Sequence[str], allowed: Sequence[str]) -> None:
    wrong = [one for one in given if one not in allowed]
    if wrong or not given:
        raise EmbodieDreamerError(f"{what} '{wrong[0] if wrong else ''}' is not one of {', '.join(allowed)}.")


def draw_task(
    folder: Path, secret: Path, tier: str, observation: str, number: int, seed: int, seconds: float = SECONDS
) -> dict[str, Any]:
    """Draw one case, and write its files and its withheld recordings; return its row of the truth.

    Raises: SimulationError if no drawn robot rests at its first command.
    """
    rng = np.random.default_rng([seed, number])
    effects, names = draw_effects(tier, observation, rng)
    recording: dict[str, Any] = {
        "seconds": seconds,
        "with_velocity": False,
        "held_out": HELD_OUT,
        **OBSERVATIONS[observation],
    }
    if tier == "subset":
        joints = 6
        recording["among"] = sorted(rng.choice(joints, int(rng.integers(2, joints)), replace=False).tolist())
    strength = draw_strength(rng, PLAIN)
    twin = draw_at_rest((), ARM, copy.deepcopy(rng), PLAIN, **recording) if effects else None
    case = draw_at_rest(effects, ARM, rng, strength, **recording)
    case = replace(case, model_json={**case.model_json, "robot": {**case.model_json["robot"], "urdf": "arm.urdf"}})
    withheld = case.test[GIVEN:]
    replace(case, test=Recordings(case.test[:GIVEN])).write(folder)
    model = RobotModel.load(folder / "model.json")
    sigma = _sensor_sd(case, signal_of(withheld[0]))
    row = _write_task(folder, secret, model, observation, names, withheld, sigma)
    change = visibility(withheld, twin.test[GIVEN:], sigma) if twin else 0.0
    return row | {"tier": tier, "effects": case.hidden, "visibility": change}


def visibility(recordings: Sequence[Recording], without: Sequence[Recording], sigma: np.ndarray) -> float | None:
    """Mean square change of recordings by an effect, over joints and samples, in units of sensor noise.

    None if the motions differ.
    """
    squares = []
    for one, other in zip(recordings, without, strict=True):
        if one.command is not None and not np.array_equal(
            one.command, np.asarray(other.command)
        ):  # another robot had to be drawn
            return None
        a, b = (np.asarray(getattr(log, signal_of(log))) for log in (one, other))
        squares.append(((a - b) / sigma) ** 2)
    return float(np.mean(np.concatenate(squares)))


def draw_effects(tier: str, observation: str, rng: np.random.Generator) -> tuple[tuple[str, ...], list[str]]:
    """The effects that a case hides, and the names that an answer may use.

    The names are those of the catalogue without LEFT_OUT effects. Only in the tier "outside" is the hidden effect one
    of those left out.
    """
    seen = [name for name in IN_EFFORT if observation == "no_command"] or list(SINGLES)
    if tier == "subset":
        seen = [name for name in seen if name not in PER_ARM]
    if tier == "outside":
        seen = [name for name in seen if name in OUTSIDE]
    effects = () if tier == "none" else (str(rng.choice(seen)),)
    if tier == "pair":
        first = str(rng.choice([name for name in seen if set(partners(name)) & set(seen)]))
        effects = (first, str(rng.choice([name for name in partners(first) if name in seen])))
    others = [name for name in CATALOGUE if name not in effects and name in OUTSIDE]
    left_out = rng.choice(others, LEFT_OUT - (tier == "outside"), replace=False).tolist()
    left_out += effects if tier == "outside" else ()
    return effects, sorted(set(CATALOGUE) - set(left_out))


def real_task(folder: Path, secret: Path, source: Path) -> dict[str, Any]:
    """A real robot as a case, with the last recording of test/ withheld; return its row of the truth, without effects.

    Raises: ModelError or RecordingError for files that cannot be used.
    """
    given = RobotModel.load(source / "model.json")
    train, test = (load_recordings(source / part) for part in ("train", "test"))
    if len(test) < 2:
        raise EmbodieDreamerError(
            f"{source / 'test'} holds {len(test)} recording; two are needed, because the last one is withheld."
        )
    folder.mkdir(parents=True)
    export_model(given, folder / "arm.urdf", "urdf")
    given.save(folder / "model.json")
    model = json.loads((folder / "model.json").read_text())
    model["robot"]["urdf"] = "arm.urdf"
    write_json(model, folder / "model.json")
    for part, logs in (("train", train), ("test", test[:-1])):
        (folder / part).mkdir()
        for log in logs:
            save_recording(log, folder / part / f"{log.name}.csv")
    by_effort = signal_of(test[-1]) == "effort"
    observation = "no_command" if by_effort else "position" if test[-1].effort is None else "effort"
    sigma = np.full(len(test[-1].joints), np.nan) if by_effort else test[-1].sigma
    loaded = RobotModel.load(folder / "model.json")
    row = _write_task(folder, secret, loaded, observation, sorted(CATALOGUE), test[-1:], sigma)
    return row | {"tier": "real", "effects": {}, "visibility": None}


def _write_task(
    folder: Path, secret: Path, model: RobotModel, observation: str, names: list[str],
    withheld: Sequence[Recording], sigma: np.ndarray,
) -> dict[str, Any]:  # fmt: skip
    """Write the MJCF, the motions to predict and case.json; the withheld recordings go into the other folder."""
    mjcf = folder / "arm.xml"
    export_model(model, mjcf)
    mjcf.write_text(mjcf.read_text().replace(str(mjcf), mjcf.name))
    signal, case = signal_of(withheld[0]), folder.name
    (folder / "predict").mkdir()
    (secret / "withheld" / case).mkdir(parents=True)
    starts = {}
    for log in withheld:
        save_recording(log, secret / "withheld" / case / f"{log.name}.csv")
        starts[log.name] = write_motion(log, folder / "predict" / f"{log.name}.csv")
    write_json({"case": case, "observation": observation, "effects": names, "joints": list(model.joints),
                "end_effectors": list(model.arms), "signal": signal, "predict": starts}, folder / "case.json")  # fmt: skip
    files = sorted((secret / "withheld" / case).iterdir())
    return {
        "case": case,
        "observation": observation,
        "signal": signal,
        "sensor_sd": [float(x) if math.isfinite(x) else None for x in sigma],
        "withheld_sha256": {file.stem: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
        "nominal_rms": nominal_rms(load_task(folder), withheld),
    }


def write_motion(recording: Recording, path: Path) -> dict[str, float]:
    """Write a withheld recording's commands (positions if it has none) for a tool; return its start by joint."""
    part = "command" if recording.command is not None else "position"
    values = recording.command if recording.command is not None else recording.position
    table = np.column_stack([recording.time, values])
    header = ",".join(["time", *(f"{joint}.{part}" for joint in recording.joints)])
    np.savetxt(
        path, table, fmt="%.9g", delimiter=",", header=header, comments=f"# command_hold: {recording.command_hold}\n"
    )
    still = max(int(np.searchsorted(recording.time - recording.time[0], 0.05, side="right")), 1)
    return dict(zip(recording.joints, recording.position[:still].mean(axis=0).tolist(), strict=True))


def nominal_rms(task: Task, withheld: Iterable[Recording]) -> float:
    """Error of the nominal model on the withheld recordings: mean over joints of the root mean square, rad or N m."""
    runs = task.predictions(task.model)
    return rms_error([(runs[log.name], log) for log in withheld])


def rms_error(pairs: Sequence[tuple[np.ndarray, Recording]]) -> float:
    """Mean over joints of the root mean square difference of predictions (T, n) and recordings, over usable samples."""
    total, count = 0.0, 0.0
    for predicted, log in pairs:
        measured = log.effort if signal_of(log) == "effort" else log.position
        total = total + (np.where(log.usable, predicted - measured, 0.0) ** 2).sum(axis=0)
        count = count + log.usable.sum(axis=0)
    return float(np.mean(np.sqrt(total / np.maximum(count, 1))))


def _sensor_sd(case: Case, signal: str) -> np.ndarray:
    """True sensor noise (n,) of the compared signal."""
    stiffness = np.array(case.truth["servo"]["stiffness"])
    if signal == "effort":
        return SENSOR["effort_noise"] * EFFORT_SCALE_ANGLE * stiffness
    return np.full(len(stiffness), math.hypot(SENSOR["noise"], SENSOR["quantum"] / math.sqrt(12)))
