"""Regenerate the recordings of the demo: a six-joint arm in MuJoCo with one hidden effect; needs the extra [standin].

python -m benchmarks.make_demo_data [--out embodiedreamer_gym/assets/demo]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import h5py
import numpy as np

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.standin.cases import draw_case

EFFECT, ARM, SEED, SECONDS = "stribeck_friction", "arm6", 6, 4.0
# Servo gains that the demo's user assumes, as from a data sheet, relative to the true ones.
STIFFNESS = (1.4, 0.7, 1.3, 0.75, 1.35, 0.7)
DAMPING = (0.7, 1.4, 0.8, 1.3, 0.7, 1.3)
FOLDER = Path(__file__).parents[1] / "embodiedreamer_gym" / "assets" / "demo"


def write_small(recording: Recording, path: Path) -> None:
    """Write the ALOHA layout in single precision, compressed, without the attribute for sensor noise."""
    signals = {
        "action": recording.command,
        "observations/qpos": recording.position,
        "observations/qvel": recording.velocity,
        "observations/effort": recording.effort,
    }
    options = {"compression": "gzip", "compression_opts": 9, "shuffle": True}
    with h5py.File(path, "w", libver="latest") as file:
        file.create_dataset("timestamps", data=np.round(recording.time, 9), **options)
        for key, array in signals.items():
            if array is not None:
                file.create_dataset(key, data=array.astype(np.float32), **options)
        file.attrs["joint_names"] = list(recording.joints)
        file.attrs["command_hold"] = recording.command_hold


def main() -> None:
    """Draw the robot and write its recordings, the user's model, and the ground truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=FOLDER)
    folder = parser.parse_args().out
    case = draw_case(EFFECT, ARM, np.random.default_rng(SEED), seconds=SECONDS)
    for part, recordings in (("train", case.train), ("test", case.test)):
        (folder / part).mkdir(parents=True, exist_ok=True)
        for recording in recordings:
            write_small(recording, folder / part / f"{recording.name}.hdf5")
    servo = {key: np.array(values) for key, values in case.model_json["servo"].items()}
    guess = {"stiffness": servo["stiffness"] * STIFFNESS, "damping": servo["damping"] * DAMPING}
    model = {"name": "demo_arm"} | case.model_json
    model["servo"] = {key: np.round(values, 3).tolist() for key, values in guess.items()}
    texts = {f"{ARM}.urdf": case.urdf, "model.json": json.dumps(model, indent=1) + "\n"}
    texts["truth.json"] = json.dumps(case.truth, indent=1) + "\n"
    for name, text in texts.items():
        (folder / name).write_text(text)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{folder}: {size / 1000:.0f} kB, hidden: {case.truth['effect']}")


if __name__ == "__main__":
    main()
