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
SETTLED = 4.0  # s, until a reference robot is at rest


class Tracker:
    """Converts actions to commands that bring the robot to the desired positions, one control period at a time.

    An action (n,) is the desired joint positions at the end of the period. With a `reference`, it is a command to that
    robot, the desired positions are those that the reference would reach, and `observed` gives the encoder readings that
    it would have. Commands stay within the joints' limits
    and change no faster than their highest speeds. Joints of unit "1" (grippers) get the action as it is, since they
    close on objects.

    model: calibrated model of the robot that receives the commands.
    hz: actions per second.
    mode: feed_forward: the command that the model needs for the motion; trim: the integral of the encoders' error,
        added to the action; both; off: the action itself, without a reference.
    Raises: ModelError for another mode, or a reference with other joints.
    """

    def __init__(self, model: RobotModel, hz: float, mode: str = "both", reference: RobotModel | None = None) -> None:
        if mode not in MODES:
            raise ModelError(f"mode '{mode}' is not one of {', '.join(MODES)}.")
        if reference is not None and reference.joints != model.joints:
            raise ModelError(f"reference {reference.name} and model {model.name} have different joints.")
        reference = None if mode == "off" else reference
        self.model, self.mode, self.reference, self.dt = model, mode, reference, 1.0 / hz
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
            self._shadow.reset(self._last)
        bump = self.mode == "trim" and self._shadow is None  # else the arm would sag at the first command
        self._trim = np.clip(self._last - position, -MOST, MOST) if bump else np.zeros(self.model.n)
        self._free = np.ones(self.model.n, bool)

    def observed(self, measured: Array) -> Array:
        """Readings (n,) of the reference's encoders with this robot's tracking error added; measured (n,) without a reference.

        The reference rests in other positions under the same command, which a policy that has learnt on it expects. The
        readings of grippers are those measured.
        """
        if self._shadow is None:
            return measured
        error = measured - self._feed.drive.reading(self._wanted)
        return np.where(self._driven, self._shadow.reading() + error, measured)

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
        self._rest: tuple[Array, Array] | None = None  # a command, and the encoders' readings at rest under it

    def reset(self, command: Array) -> None:
        """Come to rest under a command (n,)."""
        self._command, self._speed = command, np.zeros(len(command))
        if self._rest is None or not np.array_equal(self._rest[0], command):
            self._begin(command, command)
            for _ in range(round(SETTLED / self._drive.dt)):
                self._drive.advance(self._drive.accelerate(command[None]))
            self._rest = command.copy(), self.reading()
        self._begin(*self._rest)

    def _begin(self, command: Array, reading: Array) -> None:
        self._drive.start(reading[None], np.zeros((1, len(reading))), command[None])

    def reading(self) -> Array:
        """Present readings (n,) of the encoders."""
        return self._drive.read()[0]

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
