"""Real arm without commands: diagnosis of a Franka arm's friction from position and measured torque.

python -m benchmarks.real_effort [--data ../shared/data/franka_effort] [--swap] [--out FILE.json]

The baseline is plain least squares of each joint's torque on the same terms, fitted and evaluated on the same halves.
Data: github.com/marcocognetti/FrankaEmikaPandaDynModel, not shipped.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.common import data_folder, folder, save
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.phys_aligner.linear_baseline import least_squares_rms
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel


def main() -> None:
    """Print the diagnosis, and each joint's held-out error compared with least squares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=folder, default=str(data_folder("franka_effort")))
    parser.add_argument("--swap", action="store_true", help="exchange the training and the held-out half")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    model = RobotModel.load(arguments.data / "model.json")
    halves = [
        load_recordings(arguments.data / name, joints=model.joints) for name in ("exciteA_1.csv", "exciteB_2.csv")
    ]
    train, test = halves[::-1] if arguments.swap else halves
    found = diagnose(model, train, test)
    print(found)
    baseline = least_squares_rms(model, train, test)
    print(
        f"\nleast squares by joint: {', '.join(f'{1e3 * x:.0f}' for x in baseline)} mN m, mean {1e3 * baseline.mean():.0f}"
    )
    save(found.as_dict() | {"least_squares_by_joint": baseline.tolist()}, arguments.out)


if __name__ == "__main__":
    main()
