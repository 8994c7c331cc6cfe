"""Units for logs that do not state them: LeRobot's degrees and -100 .. 100, converted with its calibration file.

Source: `MotorsBus._normalize` of lerobot/motors/motors_bus.py (huggingface/lerobot 0.4.4). For a motor's ticks and the
ends lo and hi of its calibrated range, RANGE_M100_100 is 200 (ticks - lo) / (hi - lo) - 100, negated if drive_mode is
set; RANGE_0_100 is 100 (ticks - lo) / (hi - lo), or 100 minus that if drive_mode is set; DEGREES is
360 (ticks - (lo + hi) / 2) / 4095. Feetech's bus applies drive_mode, Dynamixel's does not.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError, brief
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.recordings.joint_names import find_joints
from embodiedreamer_gym.recordings.tracking import is_gripper

UNIT_KINDS = ("rad", "degrees", "degrees-middle", "range")
TICKS = 4096  # per turn
DYNAMIXEL = ("koch", "omx", "aloha", "viperx", "widowx")  # robots whose bus does not apply drive_mode
MOST = {"rad": 6 * math.pi, "degrees": 1100.0, "degrees-middle": 1100.0, "range": 101.0}  # largest plausible value


@dataclass(frozen=True)
class MotorCalibration:
    """Calibrated range of a motor, ticks, and whether LeRobot inverts it."""

    low: int
    high: int
    inverted: bool


@dataclass(frozen=True)
class MotorUnits:
    """How the numbers of a log are converted to angles.

    kind: one of UNIT_KINDS, None if not given; calibration: motor name -> calibration; limits: joint -> lowest and
    highest angle, whose middle is taken as the middle of the calibrated range; normalised: joints in 0 .. 1; sliding:
    joints in m.
    """

    kind: str | None = None
    calibration: Mapping[str, MotorCalibration] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    normalised: frozenset[str] = frozenset()
    sliding: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if self.kind is not None and self.kind not in UNIT_KINDS:
            raise RecordingError(f"units {self.kind!r} are not one of {', '.join(UNIT_KINDS)}")

    def line(self, joint: str, robot: str, source: str) -> tuple[float, float, str]:
        """Factor and offset that convert a joint's numbers to rad (m, or 0 .. 1), and a note ("" if there is none).

        Raises: RecordingError where the motor's calibration is needed but missing, or a sliding joint is in degrees.
        """
        if self.kind == "rad":
            return 1.0, 0.0, ""
        low, high = self.limits.get(joint, (-math.inf, math.inf))
        known = math.isfinite(low) and math.isfinite(high)
        gripper = is_gripper(joint, "1" if joint in self.normalised else "rad")
        if joint in self.normalised and gripper:
            return 0.01, 0.0, ""
        motor = self._motor(joint, source)
        if gripper or self.kind == "range":
            if known and (joint in self.sliding or (gripper and motor is None)):
                ends = (low, high) if gripper else ((low + high) / 2, high)
                return (ends[1] - ends[0]) / 100, ends[0], f"the range of {joint} was taken to be the model's limits"
            if motor is None or joint in self.sliding:
                what = "0 .. 100" if gripper else "-100 .. 100"
                raise RecordingError(
                    f"{source}: {what} of {joint} is a share of its motor's calibrated range; give LeRobot's calibration file "
                    "of the robot with --motor-calibration FILE.json (motor_calibration=...)"
                )
            return self._of_range(motor, gripper, low, high, robot)
        if joint in self.sliding:
            raise RecordingError(
                f"{source}: {joint} is a sliding joint, and degrees are not a length; give --units range or rad"
            )
        middle = self.kind == "degrees-middle"
        return math.radians(1) * ((TICKS - 1) / TICKS if middle else 1.0), self._middle(motor, low, high) * middle, ""

    def check(self, values: np.ndarray, joints: tuple[str, ...], source: str) -> None:
        """Raises: RecordingError where positions (T, n) cannot be in the units that the user gave, or none were given."""
        body = [j for j, name in enumerate(joints) if not is_gripper(name, "1" if name in self.normalised else "rad")]
        shown = values[:, body] if body else values
        low, high = float(shown.min()), float(shown.max())
        most = max(abs(low), abs(high))
        if self.kind is None:
            likely = ("LeRobot's degrees" if most > MOST["range"] else "LeRobot's -100 .. 100 (range), or degrees") if most > MOST["rad"] / 3 else "rad"  # fmt: skip
            raise RecordingError(
                f"{source}: the set does not state the units of these joints; they span {low:.4g} to {high:.4g}, which "
                f"resembles {likely}; give --units {', '.join(UNIT_KINDS[:-1])} or {UNIT_KINDS[-1]} (units=...)"
            )
        if most > MOST[self.kind]:
            raise RecordingError(
                f"{source}: the joints span {low:.4g} to {high:.4g}, which cannot be in the units {self.kind!r} that were given"
            )

    def _motor(self, joint: str, source: str) -> MotorCalibration | None:
        if not self.calibration:
            return None
        names = tuple(self.calibration)
        try:
            columns, _ = find_joints(names, (joint,), source)
        except RecordingError as error:
            raise RecordingError(
                f"{source}: the calibration file has no motor {joint}; it has {', '.join(names)}"
            ) from error
        return self.calibration[names[columns[0]]]

    def _of_range(
        self, motor: MotorCalibration, gripper: bool, low: float, high: float, robot: str
    ) -> tuple[float, float, str]:
        """Factor, offset and note for values in 0 .. 100 or -100 .. 100; drive_mode is undone."""
        inverted = motor.inverted and not robot.startswith(DYNAMIXEL)
        whole = (motor.high - motor.low) * 2 * math.pi / TICKS
        note = "its drive_mode was undone: it counts in the motor's own direction" if inverted else ""
        if gripper:
            start = low if math.isfinite(low) else 0.0
            return (-whole / 100, start + whole, note) if inverted else (whole / 100, start, note)
        return (-whole if inverted else whole) / 200, self._middle(motor, low, high), note

    def _middle(self, motor: MotorCalibration | None, low: float, high: float) -> float:
        """Angle at the middle of the calibrated range: middle of the limits; 0 without limits or for a whole turn."""
        turns = motor is not None and motor.high - motor.low >= TICKS - 1
        return 0.0 if turns or not math.isfinite(low + high) else (low + high) / 2


def read_motor_calibration(path: str | os.PathLike[str]) -> dict[str, MotorCalibration]:
    """Motors of LeRobot's calibration file: name -> {id, drive_mode, homing_offset, range_min, range_max}.

    Raises: RecordingError where the file is missing or has another form.
    """
    data = read_json(Path(path), RecordingError, "motor calibration")
    if not isinstance(data, dict) or not data or not all(isinstance(one, dict) for one in data.values()):
        raise RecordingError(
            f"{path}: a motor calibration must be an object of motors, as LeRobot 0.3 and later write it"
        )
    return {name: _motor(path, name, one) for name, one in data.items()}


def _motor(path: str | os.PathLike[str], name: str, data: dict[str, Any]) -> MotorCalibration:
    low, high, mode = (data.get(key) for key in ("range_min", "range_max", "drive_mode"))
    whole = all(isinstance(v, int) and not isinstance(v, bool) for v in (low, high))
    if not whole or not -TICKS < low < high < 2 * TICKS or mode not in (0, 1):  # pyright: ignore[reportOperatorIssue,reportOptionalOperand]
        raise RecordingError(
            f"{path}: {brief(name)} needs whole numbers range_min < range_max, ticks of {TICKS} in a turn, and a drive_mode of "
            f"0 or 1, not {brief(low)}, {brief(high)} and {brief(mode)}"
        )
    return MotorCalibration(low, high, bool(mode))  # pyright: ignore[reportArgumentType]
