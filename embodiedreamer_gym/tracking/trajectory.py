"""Commands for a whole trajectory, and the tracking error that the model predicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.io.tables import layout, milli
from embodiedreamer_gym.recordings import Recording, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.transmission import Transmission
from embodiedreamer_gym.simulation import TIME_STEP, Drive
from embodiedreamer_gym.simulation.inverse_drive import InverseDrive, command_path
from embodiedreamer_gym.simulation.rollout import check_names, command_rule, plant_commands
from embodiedreamer_gym.tracking.feed_forward import FeedForward

Array = np.ndarray
PASSES = 3  # corrections of the error that the command's path leaves once its lag is compensated


@dataclass(frozen=True, eq=False)
class Tracked:
    """Commands for a desired trajectory, and the predicted positions of the model's joints.

    joints, units (n,); time (T,) s; wanted (T, n): desired positions; command (T, n); before, after (T, n): predicted
    positions when the desired ones are sent as commands, and when `command` is sent. short (n,): share of the time for
    which the drive is too weak for the motion; limited (n,): share for which the joint's range or speed limits a
    command.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    wanted: Array
    command: Array
    before: Array
    after: Array
    short: Array
    limited: Array
    model: str = field(default="")

    def errors(self) -> tuple[Array, Array]:
        """Predicted root mean square errors (n,) before and after."""
        before, after = (np.sqrt(np.mean((one - self.wanted) ** 2, axis=0)) for one in (self.before, self.after))
        return before, after

    def __str__(self) -> str:
        rows = [
            [joint, milli(a, unit), milli(b, unit), "-" if a == 0 else f"{b / a:.2f}"]
            for joint, unit, a, b in zip(self.joints, self.units, *self.errors(), strict=True)
        ]
        lines = [f"expected tracking error (root mean square) over {self.time[-1] - self.time[0]:.1f} s, by {self.model}:",
                 layout(["joint", "desired sent", "commands sent", "ratio"], rows)]  # fmt: skip
        for what, share in (("the drive is too weak for the motion", self.short),
                            ("the command is limited by the joint's range or speed", self.limited)):  # fmt: skip
            lines += [
                f"note: {joint}: {what} for {100 * part:.0f} % of the time; slow the motion, or move it away from the limit."
                for joint, part in zip(self.joints, share, strict=True)
                if part > 0
            ]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """The result as a JSON-serialisable dictionary."""
        before, after = self.errors()
        return {
            "model": self.model, "seconds": float(self.time[-1] - self.time[0]),
            "joints": {
                joint: {"before": a, "after": b, "unit": unit, "drive_too_weak": s, "limited": l}
                for joint, unit, a, b, s, l in zip(self.joints, self.units, before.tolist(), after.tolist(),
                                                  self.short.tolist(), self.limited.tolist(), strict=True)
            },
        }  # fmt: skip

    def save(self, path: str | Path, transmission: Transmission | None = None) -> None:
        """Write the commands as csv (time, <joint>.command, ...); with a transmission, the commands of the motors.

        Raises: EmbodieDreamerError when the file cannot be written.
        """
        names = self.joints if transmission is None else transmission.motors
        command = self.command if transmission is None else transmission.to_motors(self.command)
        header = ",".join(["time", *(f"{name}.command" for name in names)])
        with atomic_file(path) as part:
            np.savetxt(part, np.column_stack([self.time, command]), "%.6f", ",", header=header, comments="")


def track(model: RobotModel, trajectory: Recording) -> Tracked:
    """The commands that move the model's joints along the positions of a trajectory.

    Raises: SimulationError for a trajectory of another robot; ModelError if it leaves the joints' limits.
    """
    check_names(model, trajectory)
    wanted, tree = trajectory.position, model.tree
    slack = np.maximum(1e-6, 3 * trajectory.sigma)
    out = np.argwhere((wanted < tree.lower - slack) | (wanted > tree.upper + slack))
    if len(out):
        k, j = out[0]
        raise ModelError(
            f"{trajectory.source or trajectory.name}: {model.joints[j]} should be at {wanted[k, j]:.4g} after "
            f"{trajectory.time[k] - trajectory.time[0]:.2f} s, outside its limits {tree.lower[j]:.4g} .. "
            f"{tree.upper[j]:.4g}."
        )
    heard, lead, short = _heard(model, trajectory)
    command, limited = _sent(model, trajectory, heard, lead)
    plain = np.clip(wanted, tree.lower, tree.upper)
    before, after = (joint_positions(model, trajectory.with_(command=one)) for one in (plain, command))
    return Tracked(
        model.joints, model.units, trajectory.time, wanted, command, before, after, short, limited, model.name
    )


def joint_positions(model: RobotModel, recording: Recording) -> Array:
    """Positions (T, n) of the model's joints under a recording's commands, starting at rest at its first position.

    Unlike the positions of `simulate`, which are encoder readings, these are the joints' own, beyond offsets and gears.
    """
    commands = plant_commands(recording, command_rule(model, recording))
    drive = Drive(model)
    first = InverseDrive(model, TIME_STEP).reading_at_rest(recording.position[0])[None]
    drive.start(first, np.zeros_like(first), commands[:1])
    path = np.empty_like(commands)
    for k, command in enumerate(commands):
        path[k] = drive.position[0]
        drive.advance(drive.accelerate(command[None]))
    return _at(np.tile(recording.time - recording.time[0], (model.n, 1)), np.arange(len(path)) * TIME_STEP, path)


def commands_for(model: RobotModel, trajectory: Recording) -> Array:
    """The commands (T, n) of `track`, without a simulation."""
    heard, lead, _ = _heard(model, trajectory)
    return _sent(model, trajectory, heard, lead)[0]


def _heard(model: RobotModel, trajectory: Recording) -> tuple[Array, Array, Array]:
    """Commands (T, n) that must reach the servo, their lead time (n,), s, and the time share (n,) of a weak drive."""
    motion, feed = smooth_motion(trajectory), FeedForward(model, 1.0 / trajectory.hz)
    feed.begin(motion.position[0])
    moved = np.diff(motion.position, axis=0, prepend=motion.position[:1])
    heard, short = np.empty_like(motion.position), np.zeros(model.n)
    for k in range(len(heard)):
        heard[k] = feed.step(motion.position[k], motion.velocity[k], motion.acceleration[k], moved[k])
        short += feed.drive.short / len(heard)
    hold = command_rule(model, trajectory) == "hold"
    return heard, feed.drive.lag + (0.5 / trajectory.hz if hold else 0.0), short


def _sent(model: RobotModel, trajectory: Recording, heard: Array, lead: Array) -> tuple[Array, Array]:
    """Commands (T, n) within limits and speeds, and the share (n,) of them that was limited."""
    time, rule = trajectory.time - trajectory.time[0], command_rule(model, trajectory)
    later = _at(time + lead[:, None], time, heard)
    command, limited = _limited(model, time, later)
    if lead.any():
        for _ in range(PASSES):
            grid = plant_commands(trajectory.with_(command=command), rule)
            reached = command_path(model, grid)
            missing = later - _at(time + lead[:, None], np.arange(len(grid)) * TIME_STEP, reached)
            command, limited = _limited(model, time, command + missing)
    return command, limited.mean(0)


def _at(times: Array, time: Array, signal: Array) -> Array:
    """A signal (K, n) at times (K,), interpolated at times (n, T) of each joint: (T, n)."""
    return np.stack([np.interp(t, time, one) for t, one in zip(times, signal.T, strict=True)], axis=1)


def _limited(model: RobotModel, time: Array, command: Array) -> tuple[Array, Array]:
    """Commands (T, n) within the joints' limits and speeds, and where (T, n) they were limited."""
    tree, sent = model.tree, np.clip(command, model.tree.lower, model.tree.upper)
    for k, step in enumerate(np.diff(time), 1):
        most = tree.velocity * step
        sent[k] = np.clip(sent[k], sent[k - 1] - most, sent[k - 1] + most)
    return sent, np.abs(sent - command) > 1e-9
