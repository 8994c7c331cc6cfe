"""Play a motion on a real arm at its rate and within limits, and log the arm's motion with measured stamps."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from embodiedreamer_gym.errors import RobotError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.recordings.motor_units import MotorCalibration, MotorUnits
from embodiedreamer_gym.recordings.plain_csv import read_commands
from embodiedreamer_gym.recordings.sage_csv import resample
from embodiedreamer_gym.robot.data import RobotData
from embodiedreamer_gym.robot.transmission import direct

APPROACH = 0.3  # rad/s, towards the first command
APPROACH_HZ = 50.0
PATIENCE = 0.1  # s for which a joint may be further from its command than allowed
OLDEST = 0.5  # s: largest age of a measurement
SLACK = 1.02  # of limits, for commands written with few digits


class Sample(NamedTuple):
    """A measurement of an arm: time stamp, s, of its own clock; position (n,); velocity and effort if it has them."""

    time: float
    position: np.ndarray
    velocity: np.ndarray | None = None
    effort: np.ndarray | None = None


class Arm(Protocol):
    """An arm with position servos."""

    def now(self) -> float:
        """Current time, s, of the clock of the time stamps."""
        ...

    def wait(self, until: float) -> None:
        """Return at that time, or at once if it has passed."""
        ...

    def read(self) -> Sample:
        """The latest measurement."""
        ...

    def write(self, command: np.ndarray) -> None:
        """Send positions (n,) to the servos."""
        ...


@dataclass(frozen=True, eq=False)
class SafeMotion:
    """Commands to play: joints, time (T,) s, command (T, n), and limits of each joint (n,).

    lower, upper: of commands; speed: per s; error: distance between command and position at which the arm is stopped.
    Raises: RobotError for commands beyond the limits.
    """

    joints: tuple[str, ...]
    time: np.ndarray
    command: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    error: np.ndarray

    def __post_init__(self) -> None:
        rate = np.abs(np.diff(self.command, axis=0)) / np.diff(self.time)[:, None]
        slack = (SLACK - 1) * (self.upper - self.lower)
        for j, joint in enumerate(self.joints):
            low, high = self.command[:, j].min(), self.command[:, j].max()
            if not (self.lower[j] - slack[j] <= low and high <= self.upper[j] + slack[j]):
                raise RobotError(
                    f"{joint} is sent to {low:.4g} .. {high:.4g}, beyond its limits {self.lower[j]:.3f} .. {self.upper[j]:.3f}"
                )
            if rate[:, j].max() > SLACK * self.speed[j]:
                raise RobotError(
                    f"{joint} is sent at {rate[:, j].max():.2f} per s, faster than its limit of {self.speed[j]:.2f}"
                )

    @staticmethod
    def load(path: str | Path, model: RobotData, speed: float = 2.0, error: float = 0.35) -> SafeMotion:
        """Read the commands of a csv file, with the model's limits.

        speed: limit, rad/s, unless the URDF's limit is lower; error: rad (for a gripper, share of its stroke).
        Raises: RobotError for commands beyond the limits or of other joints; RecordingError for another kind of file.
        """
        joints, time, command = read_commands(path)
        if set(joints) != set(model.joints):
            raise RobotError(
                f"{path} commands {', '.join(joints)}, but the model's joints are {', '.join(model.joints)}"
            )
        command = command[:, [joints.index(joint) for joint in model.joints]]
        tree, n = model.tree, model.n
        lower, upper = np.nan_to_num(tree.lower, neginf=-np.pi), np.nan_to_num(tree.upper, posinf=np.pi)
        limits = lower, upper, np.minimum(tree.velocity, speed), np.full(n, error)
        try:
            return SafeMotion(model.joints, time, command, *limits)
        except RobotError as reason:
            raise RobotError(f"{path}: {reason}") from reason


class ModelArm:
    """An arm with motor values, presented as an arm of the model's joints."""

    def __init__(self, arm: Arm, model: RobotData, units: MotorUnits | None = None, robot: str = "") -> None:
        self._arm, self._between, self._joints = arm, model.transmission or direct(model.joints), model.joints
        units = units or MotorUnits("rad")
        lines = [units.line(motor, robot, robot or "the arm") for motor in self._between.motors]
        self._factor, self._offset = (np.array([line[k] for line in lines]) for k in (0, 1))
        self.now, self.wait = arm.now, arm.wait

    def read(self) -> Sample:
        """The latest measurement, of the joints."""
        sample = self._arm.read()
        between, linear = self._between, self._between.matrix * self._between.sign
        velocity = None if sample.velocity is None else linear @ (self._factor * sample.velocity)
        effort = None if sample.effort is None else np.linalg.inv(linear).T @ (np.sign(self._factor) * sample.effort)
        position = linear @ (self._factor * sample.position + self._offset - between.zero)
        return Sample(sample.time, position, velocity, effort)

    def write(self, command: np.ndarray) -> None:
        """Send positions (n,) of the joints."""
        self._arm.write((self._between.to_motors(command) - self._offset) / self._factor)


def motor_units(model: RobotData, kind: str | None, calibration: Mapping[str, MotorCalibration]) -> MotorUnits:
    """Conversion of a model's motor values to angles; kind: as in `--units`."""
    between = model.transmission or direct(model.joints)
    limits = between.motor_limits(list(zip(model.tree.lower.tolist(), model.tree.upper.tolist(), strict=True)))
    kinds = dict(zip(between.motors, model.units, strict=True)) if limits else {}
    named = {unit: frozenset(name for name, other in kinds.items() if other == unit) for unit in ("1", "m")}
    return MotorUnits(kind, calibration, limits, named["1"], named["m"])


def play(arm: Arm, motion: SafeMotion, name: str = "motion", command_hold: str = "hold") -> Recording:
    """Go slowly to the first command, play the motion, and return what was sent and measured, with the arm's stamps.

    A late command is left out if the next one is due as well, so that nothing is sent faster than planned.
    command_hold: what the servos do between two commands.
    Raises: RobotError if a joint stays too far from its command, or a measurement is old or not finite; the arm is then
    commanded to hold its position, as after an interrupt.
    """
    try:
        _approach(arm, motion)
        sent, states, late = _run(arm, motion)
    except BaseException:
        with suppress(Exception):
            arm.write(np.clip(_finite(arm.read(), motion).position, motion.lower, motion.upper))
        raise
    states = [one for k, one in enumerate(states) if k == 0 or one.time > states[k - 1].time]
    time = np.array([one.time for one in states])
    commands = resample(np.array([t for t, _ in sent]), np.array([u for _, u in sent]), time, False)
    first = states[0]
    notes = (f"{late} of {len(motion.time)} commands were late and left out",) if late else ()
    return Recording(
        name, motion.joints, time - time[0], np.array([one.position for one in states]), commands,
        velocity=None if first.velocity is None else np.array([one.velocity for one in states]),
        effort=None if first.effort is None else np.array([one.effort for one in states]),
        command_hold=command_hold, notes=notes,
    )  # fmt: skip


def _approach(arm: Arm, motion: SafeMotion) -> None:
    """Go from where the arm is to the first command, in a straight line."""
    start, end = _finite(arm.read(), motion).position, motion.command[0]
    steps = max(1, int(np.ceil(np.abs(end - start).max() / APPROACH * APPROACH_HZ)))
    watch, begin = _Watch(motion), arm.now()
    for k in range(1, steps + 1):
        arm.wait(begin + k / APPROACH_HZ)
        command = start + (end - start) * k / steps
        arm.write(command)
        watch.check(arm.read(), command, arm.now())


def _run(arm: Arm, motion: SafeMotion) -> tuple[list[tuple[float, np.ndarray]], list[Sample], int]:
    """Commands with the times at which they were sent, measurements, and how many commands were left out."""
    sent: list[tuple[float, np.ndarray]] = []
    states: list[Sample] = []
    watch, begin, k, late = _Watch(motion), arm.now(), 0, 0
    while k < len(motion.time):
        arm.wait(begin + motion.time[k])
        due = int(np.searchsorted(motion.time, arm.now() - begin, side="right")) - 1
        late += max(due - k, 0)
        k = max(k, due)
        sent.append((arm.now(), motion.command[k]))
        arm.write(motion.command[k])
        states.append(watch.check(arm.read(), motion.command[k], arm.now()))
        k += 1
    return sent, states, late


def _finite(sample: Sample, motion: SafeMotion) -> Sample:
    if sample.position.shape != motion.lower.shape or not np.isfinite(sample.position).all():
        raise RobotError(
            f"the arm measures {sample.position.tolist()}, not a number for each of {', '.join(motion.joints)}"
        )
    return sample


class _Watch:
    """Stops the motion if a joint is too far from its command for too long."""

    def __init__(self, motion: SafeMotion) -> None:
        self._motion, self._since = motion, np.full(len(motion.joints), np.inf)

    def check(self, sample: Sample, command: np.ndarray, now: float) -> Sample:
        if now - sample.time > OLDEST:
            raise RobotError(
                f"stopped: the last measurement is {now - sample.time:.2f} s old; is the driver alive, with the same clock?"
            )
        error = np.abs(_finite(sample, self._motion).position - command)
        self._since = np.where(error > self._motion.error, np.minimum(self._since, sample.time), np.inf)
        over = np.flatnonzero(sample.time - self._since > PATIENCE)
        if over.size:
            j = int(over[0])
            raise RobotError(
                f"stopped: {self._motion.joints[j]} is {error[j]:.3f} from its command, more than {self._motion.error[j]:.3f} "
                f"for {PATIENCE} s; is it blocked, or the motion too fast?"
            )
        return sample
