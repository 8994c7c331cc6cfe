"""Log formats: the same numbers in every format must give the same arrays and the same verdict.

python -m benchmarks logs [--lerobot-python ENV/bin/python] [--quick] [--out FILE.json]

An SO-101 is simulated with hidden Coulomb friction; the numbers are its motors' ticks (4096 per turn). They are written
as csv, HDF5, LeRobot set (by this package, in rad), MCAP (by mcap), rosbag2 (by rosbags), and, with LeRobot's Python,
by LeRobot itself in degrees and in -100 .. 100. Positions, commands and times are compared bit for bit with the csv
(LeRobot stores float32), and so is the verdict of `diagnose`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.common import save

HZ, SECONDS, TRAIN = 50, 6.0, 2
MOTIONS = ("multisine", "point_to_point", "multisine", "point_to_point")
FRICTION = {"shoulder_lift": 0.15, "elbow_flex": 0.12}  # N m
RANGES = {"shoulder_pan": (770, 3335), "shoulder_lift": (820, 3280), "elbow_flex": (900, 3100), "wrist_flex": (960, 3140),
          "wrist_roll": (0, 4095), "gripper": (2010, 3470)}  # fmt: skip
FLOAT32 = 2.0**-23


def make_ticks() -> tuple[Any, list[tuple[Any, Any]]]:
    """The model to diagnose, and ticks (T, 6) of position and command for each motion."""
    import numpy as np

    from embodiedreamer_gym.motions import MOTIONS as KINDS
    from embodiedreamer_gym.motions import Span
    from embodiedreamer_gym.recordings import Recording
    from embodiedreamer_gym.robot import RobotModel
    from embodiedreamer_gym.simulation import simulate

    model = RobotModel.load("so101").with_(command_hold="linear")
    truth = model.with_effect("coulomb_friction").with_values({"coulomb_friction.torque": FRICTION})
    n, rng = model.n, np.random.default_rng(0)
    span = Span(np.array([0, 0, 0, 0, 0, 0.4]), np.array([0.7, 0.6, 0.6, 0.6, 0.7, 0.3]), np.full(n, 2.0))
    factor, offset = np.array([ticks_line(model, joint) for joint in model.joints]).T
    motions = []
    for k, kind in enumerate(MOTIONS):
        time = np.arange(round(SECONDS * HZ)) / HZ
        command = KINDS[kind](span, rng, SECONDS)(time)
        command = np.round(command / factor + offset)
        log = Recording(str(k), model.joints, time, x := (command - offset) * factor, x, units=model.units, command_hold="linear",
                        noise=np.zeros(n), quantum=np.zeros(n))  # fmt: skip
        position = np.round(simulate(truth, log).position / factor + offset + 0.4 * rng.standard_normal(x.shape))
        motions.append((position.astype(int), command.astype(int)))
    return model, motions


def ticks_line(model: Any, joint: str) -> tuple[float, float]:
    """Angle per tick, and the tick at angle 0; the middle of the calibrated range is the middle of the limits."""
    from math import pi

    low, high = RANGES[joint]
    j = model.joints.index(joint)
    if model.units[j] == "1":
        return 1 / (high - low), low
    middle = 0.0 if high - low >= 4095 else float(model.tree.lower[j] + model.tree.upper[j]) / 2
    return 2 * pi / 4096, (low + high) / 2 - middle / (2 * pi / 4096)


def write_all(
    folder: Path, model: Any, motions: Sequence[tuple[Any, Any]], python: Path | None
) -> dict[str, dict[str, Any]]:
    """Write the motions in every format; returns format -> arguments of `load_recordings`, and allowed differences."""
    import numpy as np

    from benchmarks.bags import write_mcap, write_rosbag2
    from embodiedreamer_gym.recordings import Recording, save_recording
    from embodiedreamer_gym.recordings.episodes import LeRobotWriter

    factor, offset = np.array([ticks_line(model, joint) for joint in model.joints]).T
    for name in ("csv", "hdf5", "mcap", "rosbag2", "rosbag2_mcap"):
        (folder / name).mkdir()
    with LeRobotWriter(folder / "set", HZ, [f"{joint}.pos" for joint in model.joints]) as writer:
        for k, (position, command) in enumerate(motions):
            x, u = ((ticks - offset) * factor for ticks in (position, command))
            log = Recording(
                str(k), model.joints, np.arange(len(x)) / HZ, x, u, units=model.units, command_hold="linear"
            )
            for kind in ("csv", "hdf5"):
                save_recording(log, folder / kind / f"{k}.{kind}")
            write_mcap(log, folder / "mcap" / f"{k}.mcap")
            write_rosbag2(log, folder / "rosbag2" / str(k))
            write_rosbag2(log, folder / "rosbag2_mcap" / str(k), mcap=True)
            writer.add_episode(x, u, {})
    found: dict[str, dict[str, Any]] = {
        name: {"paths": [folder / name / f"{k}.{name}" for k in range(len(motions))]}
        for name in ("csv", "hdf5", "mcap")
    }
    for name in ("rosbag2", "rosbag2_mcap"):
        found[name] = {"paths": [folder / name / str(k) for k in range(len(motions))]}
    sets = {"LeRobot set, rad": ("set", "rad")}
    if python is not None:
        calibration = {
            joint: {"id": k, "drive_mode": 0, "homing_offset": 0, "range_min": low, "range_max": high}
            for k, (joint, (low, high)) in enumerate(RANGES.items(), 1)
        }
        (folder / "calibration.json").write_text(json.dumps(calibration))
        arrays = {
            f"{what}_{k}": one[i] for k, one in enumerate(motions) for i, what in enumerate(("position", "command"))
        }
        np.savez(folder / "ticks.npz", motors=list(model.joints), calibration=json.dumps(calibration), hz=HZ, **arrays)  # pyright: ignore
        script = Path(__file__).with_name("lerobot_writes.py")
        done = subprocess.run([python, script, folder / "ticks.npz", folder / "theirs"], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"LeRobot did not write its sets: {done.stderr.strip()[-800:]}")
        print(done.stdout.strip().splitlines()[-1])
        sets |= {
            "LeRobot's own, degrees": ("theirs/degrees", "degrees-middle"),
            "LeRobot's own, range": ("theirs/range", "range"),
        }
    for name, (place, units) in sets.items():
        found[name] = {
            "paths": [f"{folder / place}:{k}" for k in range(len(motions))],
            "units": units,
            "folder": folder,
        }
    return found


def load(model: Any, given: dict[str, Any]) -> Any:
    """The recordings as the command loads them."""
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.recordings.motor_units import read_motor_calibration
    from embodiedreamer_gym.robot.play import motor_units

    file = given.get("folder", Path()) / "calibration.json"
    calibration = read_motor_calibration(file) if given.get("units", "rad") != "rad" else {}
    units = motor_units(model, given.get("units"), calibration)
    logs = load_recordings(*given["paths"], joints=model.joints, command_hold="linear", units=units)
    return [log.with_(units=model.units, nominal_time=False, noise=(), quantum=()) for log in logs]


def largest(logs: Sequence[Any], truth: Sequence[Any]) -> dict[str, float]:
    """Largest difference of the arrays from those of the csv, rad and s."""
    import numpy as np

    return {
        name: max(float(np.abs(getattr(a, name) - getattr(b, name)).max()) for a, b in zip(logs, truth, strict=True))
        for name in ("time", "position", "command")
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lerobot-python", type=Path, help="a Python with LeRobot, which writes sets of its own")
    parser.add_argument("--quick", action="store_true", help="arrays only, no verdicts")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, metavar="FILE.json")
    a = parser.parse_args()
    from embodiedreamer_gym.diagnosis import diagnose

    rows, good, first = [], True, None
    with tempfile.TemporaryDirectory() as folder:
        model, motions = make_ticks()
        formats = write_all(Path(folder), model, motions, a.lerobot_python)
        truth = load(model, formats["csv"])
        for name, given in formats.items():
            logs = load(model, given)
            row: dict[str, Any] = {"format": name, **largest(logs, truth)}
            allowed = 4 * FLOAT32 if "units" in given else 0.0
            if not a.quick:
                found = diagnose(model, logs[:TRAIN], logs[TRAIN:], jobs=a.jobs)
                row |= {"sentence": found.sentence, "seconds": round(found.seconds, 1)}
                first = first or found.sentence
            row["same"] = row.get("sentence") == first and all(
                row[key] <= allowed for key in ("time", "position", "command")
            )
            good = good and row["same"]
            rows.append(row)
            print(f"{name:<24} time {row['time']:.1e} s, position {row['position']:.1e}, command {row['command']:.1e}  "
                  f"{'same' if row['same'] else 'DIFFERENT'}  {row.get('sentence', '')}", flush=True)  # fmt: skip
    save(rows, a.out)
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
