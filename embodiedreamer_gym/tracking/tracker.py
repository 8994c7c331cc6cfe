"""Commands for a robot with encoders: a model's feed-forward, and a trim that integrates the remaining error."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive
from embodiedreamer_gym.tracking.feed_forward import FeedForward

Array = np.ndarray
MODES = ("off", "feed_forward", "trim", "both")
GAIN = 2.5  # 1/s, of the trim's integral
MOST = 0.4  # largest trim, in the joint's unit


class Tracker:
    """Converts actions to commands that bring the robot to the desired positions, one control period at a time.

    An action (n,) is the desired joint positions at the end of the period. With a `reference`, it is a command to that
    robot, and the desired positions are those that the reference would reach. Commands stay within the joints' limits
    and change no faster than their highest speeds. Joints of unit "1" (grippers) get the action as it is, since they
    close on objects.

    model: calibrated model of the robot that receives the commands.
    hz: actions per second.
    mode: feed_forward: the command that the model needs for the motion; trim: the integral of the encoders' error,
        added to the action; both; off: the action itself.
    Raises: ModelError for another mode, or a reference with other joints.
    """

    def __init__(self, model: RobotModel, hz: float, mode: str = "both", reference: RobotModel | None = None) -> None:
        if mode not in MODES:
            raise ModelError(f"mode '{mode}' is not one of {', '.join(MODES)}.")
        if reference is not None and reference.joints != model.joints:
            raise ModelError(f"reference {reference.name} and model {model.name} have different joints.")
        self.model, self.mode, self.dt = model, mode, 1.0 / hz
        self._forward, self._trims = mode in ("feed_forward", "both"), mode in ("trim", "both")
        self._feed = FeedForward(model, self.dt)
        self._shadow = None if reference is None else _Shadow(reference, self.dt)
        self._driven = np.array([unit != "1" for unit in model.units])
        self._known = np.zeros((0, model.n))

    def reset(self, position: Array, command: Array) -> None:
        """Start at rest, with the encoders reading a position (n,) under a command (n,)."""
        self._last = np.array(command, float)
        start = 2 * position - self._feed.drive.reading_at_rest(position)
        self._feed.begin(start)
        self._wanted = start
        self._known = np.zeros((0, self.model.n))
        if self._shadow is not None:
            self._shadow.reset(start, self._last)
        bump = self.mode == "trim" and self._shadow is None  # else the arm would sag at the first command
        self._trim = np.clip(self._last - position, -MOST, MOST) if bump else np.zeros(self.model.n)
        self._free = np.ones(self.model.n, bool)

    def preview(self, actions: Array) -> None:
        """Announce the actions (k, n) that will follow, the next one first."""
        self._known = np.array(actions, float)

    def command(self, action: Array, measured: Array) -> Array:
        """Command (n,) of this period; measured (n,): what the encoders read at its beginning."""
        action = np.asarray(action, float)
        if self.mode == "off":
            return action
        coming = self._known if len(self._known) and np.array_equal(self._known[0], action) else action[None]
        self._known = coming[1:]
        path = coming if self._shadow is None else self._shadow.follow(action)
        error = np.where(self._driven, self._feed.drive.reading(self._wanted) - measured, 0.0)
        if self._trims:
            self._trim = np.clip(self._trim + GAIN * self.dt * np.where(self._free, error, 0.0), -MOST, MOST)
        base = self._feed.command(path, error if self._trims else 0.0)
        weak = self._feed.drive.short  # no command removes their error
        self._wanted = path[0]
        wanted = np.where(self._driven, (base if self._forward else action) + self._trim, action)
        sent = self._limited(wanted)
        self._free = (sent == wanted) & ~weak
        return sent

    def _limited(self, wanted: Array) -> Array:
        """Commands within the joints' limits and highest speeds."""
        tree, most = self.model.tree, self.model.tree.velocity * self.dt
        inside = np.clip(wanted, tree.lower, tree.upper)
        sent = np.where(self._driven, np.clip(inside, self._last - most, self._last + most), inside)
        self._last = sent
        return sent


class _Shadow:
    """The reference robot, simulated under the same actions."""

    def __init__(self, model: RobotModel, period: float) -> None:
        self._steps = int(np.ceil(period / TIME_STEP - 1e-9))
        self._drive, self._period, self._hold = (
            Drive(model, dt=period / self._steps),
            period,
            model.command_hold == "hold",
        )

    def reset(self, position: Array, command: Array) -> None:
        self._command, self._speed = command, np.zeros(len(command))
        self._drive.start(position[None], np.zeros((1, len(position))), command[None])

    def follow(self, action: Array) -> Array:
        """Positions (2, n) at the end of a period under an action (n,), and a period later at the same acceleration."""
        drive, before = self._drive, self._command
        for k in range(1, self._steps + 1):
            heard = action if self._hold else before + (action - before) * (k / self._steps)
            drive.advance(drive.accelerate(heard[None]))
        self._command = action
        speed, before = drive.velocity[0], self._speed
        self._speed = speed
        return drive.position[0] + np.outer([0.0, self._period], 1.5 * speed - 0.5 * before)
