"""An unknown industrial arm: motor currents, Coulomb friction on every joint, and a wrist with coupled motors.

python -m benchmarks coupled_wrist [--seeds 5] [--first-seed 0] [--out FILE.json]

Positions and efforts of a stand-in arm without effects are recorded. Friction is added to the efforts, and the motor of
joint 6 also turns with joint 5, as in the wrists of some industrial arms. Each joint's effort is a current with its own
torque constant. The catalogue has no effect for the coupling. Plain least squares is the baseline.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import save, times
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.recordings import Recording, load_recordings, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.labels import draw_at_rest

FRICTION = np.array([2.4, 3.0, 1.8, 0.75, 0.45, 0.3])  # N m, of each joint, times 0.7 to 1.3
MOTOR = (0.8, 0.3)  # Coulomb friction of motor 6, and its viscous friction per rad/s, relative to joint 6's friction
ROTOR = 0.01  # kg m^2, of motor 6


def rubbed(recording: Recording, friction: np.ndarray, constant: np.ndarray) -> Recording:
    """The recording with friction (n,) N m, a coupled wrist, and efforts as currents with constants (n,) A/(N m)."""
    motion, effort = smooth_motion(recording), np.array(recording.effort)
    v, a, own = motion.velocity, motion.acceleration, friction[5]
    effort += friction * np.sign(v)
    effort[:, 4] += MOTOR[0] * own * np.sign(v[:, 5]) + MOTOR[1] * own * v[:, 5] + ROTOR * a[:, 5]
    both = np.sign(v[:, 4] + v[:, 5]) - np.sign(v[:, 5])
    effort[:, 5] += MOTOR[0] * own * both + MOTOR[1] * own * v[:, 4] + ROTOR * a[:, 4]
    return recording.with_(effort=effort * constant, effort_unit="A")


def study(seed: int) -> dict:
    """Diagnosis of one robot."""
    rng = np.random.default_rng([seed, 11])
    case = draw_at_rest((), "arm6", rng, 1.0, seconds=10, with_velocity=False, with_command=False)
    constant, friction = rng.uniform(0.3, 1.5, 6), FRICTION * rng.uniform(0.7, 1.3, 6)
    with tempfile.TemporaryDirectory() as folder:
        model = RobotModel.load(case.write(Path(folder)))
        parts = [load_recordings(Path(folder, part)) for part in ("train", "test")]
        train, test = ([rubbed(r, friction, constant) for r in part] for part in parts)
        found = diagnose(model, train, test, jobs=1)
    named = found.parameters.get("coulomb_friction", {})
    known = {j: row for j, row in named.items() if row["low"] is not None}
    held = [
        bool(known[j]["low"] <= f <= known[j]["high"])
        for j, f in zip(model.joints, friction, strict=True)
        if j in known
    ]
    return {"seed": seed, "verdict": found.verdict, "effects": list(found.effects), "joints": len(named), "intervals": held,
            "error": found.error, "notes": list(found.notes), "seconds": found.seconds}  # fmt: skip


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=times, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    if arguments.first_seed < 0:
        parser.error("--first-seed must be at least 0.")
    if arguments.out and not arguments.out.parent.is_dir():
        parser.error(f"{arguments.out.parent} is not a folder; --out needs one that exists.")
    rows = []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        row = study(seed)
        rows.append(row)
        error = {key: f"{1e3 * value:.0f}" for key, value in row["error"].items() if isinstance(value, float)}
        print(f"robot {seed}: {row['verdict']} {', '.join(row['effects'])} on {row['joints']} of 6 joints, "
              f"{sum(row['intervals'])} of {len(row['intervals'])} intervals; held out (mA) {error}", flush=True)  # fmt: skip
    save({"rows": rows}, arguments.out)


if __name__ == "__main__":
    main()
