"""LeRobot writes an SO-101's ticks as sets in its degrees and in -100 .. 100; run it in LeRobot's own environment.

python lerobot_writes.py TICKS.npz FOLDER

TICKS.npz: motors, calibration (JSON), hz, and for each episode K position_K and command_K in whole ticks. LeRobot's bus
does the normalisation; the sets are FOLDER/degrees and FOLDER/range.
"""

from __future__ import annotations

import importlib.metadata
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.motors import motors_bus
from lerobot.motors.feetech.feetech import FeetechMotorsBus
from lerobot.motors.feetech.tables import MODEL_RESOLUTION

BUS = getattr(motors_bus, "SerialMotorsBus", None) or motors_bus.MotorsBus
MODES = motors_bus.MotorNormMode


def normaliser(motors: list[str], calibration: dict[str, dict[str, int]], mode: MODES) -> SimpleNamespace:
    """A stand-in with the attributes that the bus's normalisation needs; no bus is connected."""
    kinds = {
        name: motors_bus.Motor(k + 1, "sts3215", MODES.RANGE_0_100 if name == "gripper" else mode)
        for k, name in enumerate(motors)
    }
    return SimpleNamespace(
        calibration={name: motors_bus.MotorCalibration(**calibration[name]) for name in motors}, motors=kinds,
        apply_drive_mode=FeetechMotorsBus.apply_drive_mode, model_resolution_table=MODEL_RESOLUTION,
        _id_to_name=lambda number: motors[number - 1], _id_to_model=lambda number: kinds[motors[number - 1]].model,
    )  # fmt: skip


def main() -> None:
    data, folder = np.load(sys.argv[1]), Path(sys.argv[2])
    motors, calibration, hz = data["motors"].tolist(), json.loads(str(data["calibration"])), int(data["hz"])
    feature = {"dtype": "float32", "shape": (len(motors),), "names": [f"{name}.pos" for name in motors]}
    for name, mode in (("degrees", MODES.DEGREES), ("range", MODES.RANGE_M100_100)):
        bus = normaliser(motors, calibration, mode)
        values = lambda ticks: list(BUS._normalize(bus, dict(enumerate(ticks.tolist(), 1))).values())  # noqa: E731, B023
        written = LeRobotDataset.create(
            f"local/{name}",
            hz,
            {"observation.state": feature, "action": feature},
            folder / name,
            "so101_follower",
            use_videos=False,
        )
        for k in range(sum(key.startswith("position_") for key in data)):
            for position, command in zip(data[f"position_{k}"], data[f"command_{k}"], strict=True):
                rows = {"observation.state": values(position), "action": values(command)}
                written.add_frame({**{key: np.array(row, np.float32) for key, row in rows.items()}, "task": "move"})
            written.save_episode()
        written.finalize()
    print(f"lerobot {importlib.metadata.version('lerobot')}")


if __name__ == "__main__":
    main()
