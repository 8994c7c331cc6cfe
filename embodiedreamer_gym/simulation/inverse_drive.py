"""Inverse of the drive: the command that moves the joints as wanted, computed stage by stage from joint to command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import JointState
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive

Array = np.ndarray
LOOPS = 2  # iterations for friction that depends on the torque
NUDGE, CLOSE = 1e-4, 1e-9  # relative step and tolerance of the search for a law's input
WIDENED, HALVED = 24, 40  # iterations of that search
SLOPE, SETTLED = 0.1, 1.0  # unit/s and s of the ramp that measures the lag of commands


class InverseDrive(Drive):
    """Computes the commands for wanted motions of one robot, instant by instant; `step` advances its laws' memories.

    The torque of the rigid bodies, the laws of the stage "load" and friction give the torque that has to reach a joint.
    For the stages "drive", "torque" and "servo", the input that gives it is searched numerically, whatever their laws
    are, so a user's own effect needs no inverse. `lag` is the delay of the stage "command". The deflection of a
    compliant gear under its load is added.

    dt: time between two instants, s.
    """

    def __init__(self, model: RobotModel, dt: float) -> None:
        super().__init__(model, None, 1, dt)
        self.lag = _lag(model)
        self.short = np.zeros(model.n, bool)

    def begin(self, position: Array) -> None:
        """Put the joints at rest at a position (n,), with all memories at rest."""
        q = np.array(position, float)[None]
        still = np.zeros_like(q)
        self.start(q, still, q)
        self.position, self.velocity, self.torque = q, still, still
        self._pulled: Array | None = None
        self._wound = self._after_gear(self._weight() - self._try("load", still, self._joint))

    def memories(self) -> tuple[Any, ...]:
        """The state that `step` changes, to be restored by `recall`."""
        laws = [law for laws in self.laws.values() for law in laws]
        return self.torque, self.time, self._joint, self._wound, self._pulled, tuple((law, law.memory) for law in laws)

    def recall(self, memories: tuple[Any, ...]) -> None:
        """Restore the state at the time when `memories` was called."""
        self.torque, self.time, self._joint, self._wound, self._pulled, laws = memories
        for law, memory in laws:
            law.memory = memory

    def step(self, position: Array, velocity: Array, acceleration: Array, direction: Array) -> Array:
        """Command (n,) that must reach the servo now for this motion (n,); `short` shows where the drive is too weak.

        direction: -1 to 1; its sign is that of the motion that friction resists, its size the share of the friction.
        """
        q, v, a, way = (np.array(x, float)[None] for x in (position, velocity, acceleration, direction))
        self._joint = joint = JointState(q, v, self.torque, self.dt, self.time)
        servo, zero = self.servo, np.zeros_like(q)
        bodies = self.model.bodies.inverse_dynamics(q, v, a, self._masses)[0]
        load = self._pass("load", zero, joint)
        moved = bodies + servo["rotor_inertia"] * a + servo["viscous_friction"] * v - load
        arriving = moved
        for _ in range(LOOPS if self._rubbing else 0):
            forward, backward = self._friction(joint, arriving, load)
            arriving = moved + np.where(way > 0, forward, backward) * way
        wound = self._after_gear(bodies - load)
        motor = JointState(q + wound, v + (wound - self._wound) / self.dt, self.torque, self.dt, self.time)
        torque = (
            searched(lambda x: self._try("drive", x, motor), arriving, arriving) if self.laws["drive"] else arriving
        )
        top, bottom = self._strongest(motor)
        self.torque = np.minimum(np.maximum(torque, -bottom), top)
        self.short = (torque != self.torque)[0]
        self._pass("drive", self.torque, motor)
        error = self._error(self.torque + servo["damping"] * motor.velocity, motor)
        self._wound, self.time = wound, self.time + self.dt
        return (self._pass("sensor", motor.position, motor) + error)[0]

    def reading(self, position: Array) -> Array:
        """Sensor readings (n,) if the joints are at a position (n,) as wanted."""
        q = np.array(position, float)[None] + self._wound
        return self._try("sensor", q, JointState(q, np.zeros_like(q), self.torque, self.dt, self.time))[0]

    def reading_at_rest(self, position: Array) -> Array:
        """Sensor readings (n,) of motors that rest at a position (n,)."""
        q = np.array(position, float)[None]
        still = np.zeros_like(q)
        self.start(q, still, q)
        return self._try("sensor", q, JointState(q, still, still, self.dt, 0.0))[0]

    def _after_gear(self, carried: Array) -> Array:
        """Position difference (1, n) between motors and joints that carry a torque."""
        if not self._gives:
            return np.zeros_like(carried)
        turn = carried / (0.01 * self.servo["stiffness"])  # the teeth change sides within 0.01 unit of error
        return self._gear[0] * carried + self._gear[2] * np.clip(turn, -1.0, 1.0)

    def _strongest(self, motor: JointState) -> tuple[Array, Array]:
        """The drive's highest torque (1, n) forward and backward at the motors' speed."""
        ahead, back, fast, slow, stall = self._limits(motor)
        v = motor.velocity
        return np.minimum(ahead, stall * (1 - v / fast)), np.minimum(back, stall * (1 + v / slow))

    def _error(self, asked: Array, motor: JointState) -> Array:
        """Position error (1, n) at which the servo commands a torque, before its damping; its memories are advanced."""
        measured = self._try("sensor", motor.position, motor)
        pull, stiffness = asked, self.servo["stiffness"]
        if self._asked.counts:
            before = self._pulled

            def given(x: Array, keep: bool = False) -> Array:
                turned = x - before if before is not None else np.zeros_like(x)
                # the command's velocity is that of the motor plus that of the error
                slope = np.divide(turned, stiffness * self.dt, out=np.zeros_like(x), where=stiffness > 0.0)
                return self._asked.given(x, measured, motor, motor.velocity + slope, keep)

            pull = searched(given, asked, asked)
            given(pull, keep=True)
            self._pulled = pull
        wanted = np.divide(pull, stiffness, out=np.zeros_like(pull), where=stiffness > 0.0)
        error = searched(lambda x: self._try("servo", x, motor), wanted, wanted) if self.laws["servo"] else wanted
        self._pass("servo", error, motor)
        return error


def searched(law: Callable[[Array], Array], wanted: Array, guess: Array) -> Array:
    """The x (B, n) at which a non-decreasing law gives the wanted value or comes nearest to it, close to the guess."""
    x = np.array(guess, float)
    step = NUDGE * (1.0 + np.abs(x))
    for left in (2, 1, 0):  # a linear law needs no more
        given = law(x)
        near = np.abs(wanted - given) <= CLOSE * (1.0 + np.abs(wanted))
        if near.all():
            return x
        if left:
            slope = (law(x + step) - given) / step
            x = np.where(near, x, x + np.divide(wanted - given, slope, out=np.zeros_like(x), where=slope > 1e-6))
    low, high, reach = np.array(guess, float), np.array(guess, float), 16.0 * step
    for _ in range(WIDENED):
        above, below = law(low) > wanted, law(high) < wanted
        if not (above | below).any():
            break
        low, high, reach = np.where(above, low - reach, low), np.where(below, high + reach, high), 2.0 * reach
    wanted = np.clip(wanted, law(low), law(high))
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        under = law(middle) < wanted
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return np.where(near, x, high)


def command_path(model: RobotModel, commands: Array, dt: float = TIME_STEP) -> Array:
    """Commands (K, n) that reach the servo when commands (K, n) are sent at intervals dt; at rest at first."""
    drive, still = Drive(model, dt=dt), np.zeros((1, model.n))
    drive.start(commands[:1], still, commands[:1])
    heard = np.empty_like(commands)
    for k, command in enumerate(commands):
        joint = JointState(heard[max(k - 1, 0)][None] if k else commands[:1], still, still, dt, k * dt)
        heard[k] = drive._pass("command", command[None], joint)[0]
    return heard


def _lag(model: RobotModel) -> Array:
    """Delay (n,) in s after which a steadily moving command reaches the servo."""
    if not any(getattr(effect, "stage", "") == "command" for effect in model.effects):
        return np.zeros(model.n)
    times = np.arange(round(SETTLED / TIME_STEP) + 1) * TIME_STEP
    ramp = np.clip(np.zeros(model.n), model.tree.lower, model.tree.upper) + SLOPE * times[:, None]
    return (ramp[-1] - command_path(model, ramp)[-1]) / SLOPE
