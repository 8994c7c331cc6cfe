"""Functions shared by the verbs that work on logs: loading models and recordings, and parsing their options."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError

USELESS = "no-command"  # code of a finding: the log cannot be simulated
UNFIT = ("swapped", "sign-flipped", "units")  # codes of findings: no model can be fitted to the log
STILL = 0.01  # rad, m or share: a log in which every joint moves less cannot be fitted
FAULT = {"error": "fault"}  # "error: ..." is reserved for the last line of a failed command
T = TypeVar("T")


def load_model(a: argparse.Namespace, source: str) -> Any:
    """Return the model of a file or a built-in robot, with the effects and changes that the options give."""
    from embodiedreamer_gym.effects import CATALOGUE, load_effects
    from embodiedreamer_gym.robot import RobotModel
    from embodiedreamer_gym.robot.urdf_notes import urdf_notes

    catalogue = load_effects(a.effects) if a.effects else CATALOGUE
    model = readable(f"model {source}", lambda: RobotModel.load(source, catalogue))
    for note in urdf_notes(model.urdf):
        print(f"warning: {note}", file=sys.stderr)
    if getattr(a, "fix", None):
        model = model.with_fixed(*(name.strip() for name in a.fix.split(",")))
    if getattr(a, "zero", None) or getattr(a, "reverse", None):
        from embodiedreamer_gym.robot.transmission import direct

        names = [name.strip() for name in a.reverse.split(",")] if a.reverse else []
        between = (model.transmission or direct(model.joints)).with_motors(
            _motor_zeros(a.zero) if a.zero else {}, names
        )
        model = model.with_(transmission=between)
    if getattr(a, "urdf_trust", None):
        model = model.with_(urdf_error=_urdf_error(a.urdf_trust))
    return model


def _urdf_error(text: str) -> Any:
    """Standard deviations from "10,10,20": masses in %, centres in mm, inertias in %."""
    from embodiedreamer_gym.robot.data import UrdfError

    try:
        mass, centre, inertia = (float(part) for part in text.split(","))
    except ValueError as error:
        raise EmbodieDreamerError(f"--urdf-trust {text} is not three numbers such as 10,10,20.") from error
    return UrdfError(mass / 100, centre / 1000, inertia / 100)


def load_split(a: argparse.Namespace, model: Any) -> tuple[Any, Any]:
    """Return the recordings of --train and --test."""
    train, test = load_logs(a, model, a.train, fit=True), load_logs(a, model, a.test, fit=True)
    fitted = {(one.source, one.name) for one in train if one.source}
    both = [one for one in test if (one.source, one.name) in fitted]
    if both:
        raise RecordingError(
            f"{both[0].source} is in --train and in --test; a held-out recording must be in --test only."
        )
    return train, test


def load_logs(a: argparse.Namespace, model: Any, patterns: Sequence[str], fit: bool = False) -> Any:
    """Return recordings with bad samples marked unusable; prints the findings. fit: a model will be fitted to them."""
    from embodiedreamer_gym.recordings import Recordings, preflight_all

    ends = list(zip(model.tree.lower.tolist(), model.tree.upper.tolist(), strict=True))
    logs = joint_logs(a, model, patterns)
    checked = preflight_all(logs, dict(zip(model.joints, ends, strict=True)))
    findings: dict[Any, list[Any]] = {}
    for one in checked:
        for finding in one.findings:
            findings.setdefault((finding.severity, finding.code, finding.joints), []).append((one.recording, finding))
            if finding.code == USELESS or (fit and finding.code in UNFIT):
                raise RecordingError(f"{one.recording.source or one.recording.name}: {finding.message}.")
    for (severity, *_), same in findings.items():
        more = f" (and {len(same) - 1} more)" if len(same) > 1 else ""
        print(f"{FAULT.get(severity, severity)}: {same[0][0].name}{more}: {same[0][1].message}", file=sys.stderr)
    left_out = sum(sum(one.excluded.values()) for one in checked)
    total = sum(one.recording.position.size for one in checked)
    print(f"{len(checked)} recordings, {left_out} of {total} joint samples left out", file=sys.stderr)
    if left_out == total:
        raise RecordingError("no usable sample is left in "
                             f"{', '.join(one.recording.name for one in checked[:3])}{' and others' * (len(checked) > 3)}: "
                             "all samples are faulty or in contact.")  # fmt: skip
    _note_commands(model, logs)
    if fit and max(np.ptp(one.position, axis=0).max() for one in logs) < STILL:
        raise RecordingError(
            f"no joint moves by {STILL} {model.units[0]} or more in {logs[0].source or logs[0].name}"
            f"{' and the others' if len(logs) > 1 else ''}: a model cannot be fitted to a robot at rest."
        )
    return Recordings(one.recording for one in checked)


def _note_commands(model: Any, logs: Sequence[Any]) -> None:
    """Print how commands are interpreted if neither the model nor a log states it, and a fit does not decide it."""
    open_logs = [one.name for one in logs if one.command_hold == "unknown"]
    if model.command_hold == "unknown" and open_logs:
        more = f" (and {len(open_logs) - 1} more)" if len(open_logs) > 1 else ""
        print(
            f"info: {open_logs[0]}{more}: command_hold is unknown; unless a fit decides it, the servo is assumed to ramp "
            "from one command to the next (--hold linear); if it holds each command, give --hold hold",
            file=sys.stderr,
        )


def joint_logs(a: argparse.Namespace, model: Any, patterns: Sequence[str]) -> list[Any]:
    """Return recordings of the model's joints, without checks."""
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.recordings.motor_units import read_motor_calibration
    from embodiedreamer_gym.robot.play import motor_units
    from embodiedreamer_gym.robot.transmission import direct

    between = model.transmission or direct(model.joints)
    load = lambda: load_recordings(  # noqa: E731
        *patterns, hz=a.hz, joints=between.motors, command_hold=a.hold, time_unit=a.time_unit, episodes=a.episodes,
        state_topic=a.state_topic, command_topic=a.command_topic, gains=_gains(a),
        units=motor_units(model, a.units, read_motor_calibration(a.motor_calibration) if a.motor_calibration else {}),
    )  # fmt: skip
    return [between.to_joints(r, model.joints).with_(units=model.units) for r in readable("a recording", load)]


def _motor_zeros(text: str) -> dict[str, float]:
    """Motor zeros from text such as "elbow=1.57,wrist=-0.1"."""
    zeros = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            zeros[name.strip()] = float(value)
        except ValueError as error:
            raise EmbodieDreamerError(
                f"--zero {text} is not a list of motors with values such as elbow=1.57,wrist=-0.1."
            ) from error
    return zeros


def _gains(a: argparse.Namespace) -> dict[str, float]:
    """Pattern -> gain of --gain. Raises: RecordingError for a pattern that matches none of the command's files."""
    from embodiedreamer_gym.recordings.files import matching_files

    gains = getattr(a, "gain", [])
    given = [one for name in ("recordings", "train", "test", "sessions") for one in getattr(a, name, [])]
    paths = list(matching_files(*given)) if gains else []
    for pattern, _ in gains:
        if not any(path.match(pattern) for path in paths):
            raise RecordingError(
                f"--gain {pattern}: no recording has a name that matches; one of the recordings is {paths[0]}."
            )
    return dict(gains)


def readable(what: str, load: Callable[[], T]) -> T:
    """Load a user's file; any exception of a library becomes an EmbodieDreamerError with a one-sentence message."""
    try:
        return load()
    except EmbodieDreamerError:
        raise
    except Exception as error:
        raise EmbodieDreamerError(f"{what} cannot be read: {type(error).__name__}: {error}.") from error
