"""The driven joints of a batch of robots: command path, servo, drive, mechanics, sensors, in this order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import is_
from types import SimpleNamespace
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import JointState, SignalLaw, TorqueBudget
from embodiedreamer_gym.effects.effect import STAGES
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.robot.data import SERVO_GROUPS
from embodiedreamer_gym.robot.dynamics import lanes
from embodiedreamer_gym.robot.parameters import by_key
from embodiedreamer_gym.simulation.drive_setup import (
    Law,
    arm_blocks,
    changed_mechanics,
    cut_memory,
    gear_parts,
    parameter_values,
    tile,
)
from embodiedreamer_gym.simulation.joint_solver import FASTEST, move, solve_step, step_joints, within_limits
from embodiedreamer_gym.simulation.servo_torque import ServoTorque

TIME_STEP = 1.0 / 240.0  # s, the same as in the environment
UNLIMITED = 1e12  # N m or rad/s
SAGS = 3  # iterations to find the rest position of joints on compliant gears
PASSES = 2  # iterations for a nonlinear law of the drive
NUDGE, STRAIGHT = 1e-4, 1e-6  # relative torque step for its slope, and relative error up to which it counts as linear
# group of parameters, or its text form ("stiffness", "payload.mass") -> values (P, joints or arms)
Sets = Mapping[str, np.ndarray] | Mapping[ParameterKey, np.ndarray]


class Drive:
    """Computes joint accelerations from commands, for the simulations of fits and for environments.

    A batch holds P parameter sets for each of R rollouts, B = R * P samples, sample b = rollout * P + set.
    gains: (R, n) factors of the stiffness of each rollout, from the firmware's position gains; nothing else is scaled.
    """

    def __init__(
        self, model: RobotModel, sets: Sets | None = None, rollouts: int = 1, dt: float = TIME_STEP,
        gains: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.model, self.dt = model, dt
        values = by_key(sets or {})
        self.sets = max((len(v) for v in values.values()), default=1)
        self.rollouts = rollouts
        servo = {
            g: np.broadcast_to(values.get(ParameterKey(g), model.group_values(ParameterKey(g))), (self.sets, model.n))
            for g in SERVO_GROUPS
        }
        effects = [(effect, parameter_values(effect, model, values, self.sets)) for effect in model.effects]
        self.mechanics = changed_mechanics(model, servo["rotor_inertia"], effects)
        self._masses = model.bodies.pack(self.mechanics)
        servo["rotor_inertia"] = self.mechanics.rotor_inertia
        self._servo = np.stack([tile(v, rollouts) for v in servo.values()])
        if gains is not None:
            self._servo[SERVO_GROUPS.index("stiffness")] *= np.repeat(gains, self.sets, axis=0)
        tiled = [(e, SimpleNamespace(**{k: tile(v, rollouts) for k, v in p.items()})) for e, p in effects]
        self.laws = {s: [Law(e, p) for e, p in tiled if isinstance(e, SignalLaw) and e.stage == s] for s in STAGES}
        self._asked = ServoTorque(model, self.laws["torque"], self._servo[1])
        self.budgets = [(e, p) for e, p in tiled if isinstance(e, TorqueBudget)]
        self._limiting = [(e, p) for e, p in self.budgets if type(e).drive is not TorqueBudget.drive]
        self._rubbing = [(e, p) for e, p in self.budgets if type(e).friction is not TorqueBudget.friction]
        self._feels_external = any(effect.feels_external for effect, _ in self._rubbing)
        self._gear = gear_parts(self.mechanics, self.sets, model.n, rollouts)
        self._gives = self._gear.shape[1] > 0
        self._loose = self._gear[0] + self._gear[2] > 0.0
        self._stops = np.stack([model.tree.lower, model.tree.upper])
        self._blocks = arm_blocks(model.tree.arm)
        self.batch = self.sets * rollouts

    @property
    def servo(self) -> dict[str, np.ndarray]:
        """Values (B, n) of the servo's groups."""
        return dict(zip(SERVO_GROUPS, self._servo, strict=True))

    def start(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> None:
        """Set the joints to the measured positions (B, n), with all memories at rest at the first command."""
        self.velocity = np.array(velocity, float)
        self.time = 0.0
        self._joint = JointState(measured, self.velocity, np.zeros_like(self.velocity), self.dt, 0.0)
        self.measured = np.array(measured, float)
        self._joint.position = self.position = 2 * measured - self._begin("sensor", measured)  # exact for an offset
        heard = self._begin("command", command)
        pull = self._servo[0] * self._begin("servo", heard - measured)
        if self._asked.counts:
            pull = self._asked.start(pull, heard, measured, self._joint, self._carried())
        surplus = self._begin("drive", pull) - self._weight()
        load = self._begin("load", surplus) - surplus
        self.motor, self.spin = self.position, self.velocity
        for _ in range(SAGS if self._gives else 0):
            carried = self._weight() - load
            self.position = self.motor - self._gear[0] * carried - self._gear[2] * np.sign(carried)
        self._impulse = np.zeros_like(self.position)
        self._before, self._spun = self.velocity, self.spin
        self.torque = self.measured_acceleration = np.zeros_like(self.position)
        self._neutral()

    def _weight(self) -> np.ndarray:
        """Torque (B, n) that holds the joints at their positions."""
        still = np.zeros_like(self.position)
        return self.model.bodies.mass_matrix_and_bias(self.position, still, self._masses)[1]

    def _carried(self) -> np.ndarray:
        """Torque (B, n) that the servo has to command to hold the joints at their positions."""
        carried = self._weight() - self._begin("load", np.zeros_like(self.position))
        if not self.laws["drive"]:
            return carried
        self._begin("drive", carried)
        gain, shift = self._line(carried, self._joint)
        return np.divide(carried - shift, gain, out=carried, where=gain > 0.0)

    def _begin(self, stage: str, signal: np.ndarray) -> np.ndarray:
        """Put a stage's memories at rest at its first signal (B, n), and return its output for that signal."""
        signal = np.array(signal, float)
        for law in self.laws[stage]:
            law.memory = law.effect.start(signal, law.p, self.dt)
            signal, _ = law.effect.law(signal, self._joint, law.memory, law.p)
        return signal

    def _neutral(self) -> None:
        """Create arrays for a drive without friction, limits and laws, the budgets' last results, and the solver."""
        shape, bodies = self.position.shape, self.model.bodies
        self._rigid = lanes(self.batch), bodies.links, bodies.frames, *self._masses
        self._inertia = np.empty((*shape, self.model.n)), np.empty(shape)  # mass matrix and bias of the last step
        self._fixed = self._stops, self._gear, self._blocks, self.dt
        self._zero, self._no_friction = np.zeros(shape), np.zeros((2, *shape))
        self._unlimited, self._straight = np.full((5, *shape), UNLIMITED), np.stack([np.ones(shape), np.zeros(shape)])
        self._limited: tuple[list[Any], np.ndarray] = [], self._unlimited
        self._rubbed: tuple[list[Any], np.ndarray] = [], self._no_friction

    def accelerate(self, command: np.ndarray) -> np.ndarray:
        """Acceleration (B, n) of this step under the command (B, n); sets `measured` and `torque` of this instant.

        `torque` is that of the drive before its laws, to which its current is proportional. `measured_acceleration` is
        that of the measured positions: of the motor if a gear is compliant.
        """
        joint, motor = self._instant()
        self.measured = self._pass("sensor", motor.position, motor)
        heard = self._pass("command", command, motor)
        pull = self._servo[0] * self._pass("servo", heard - self.measured, motor)
        if self._asked.counts:
            pull = self._asked.torque(pull, heard, self.measured, motor)
        load = self._pass("load", self._zero, joint)
        limits, line, friction = self._unlimited, self._straight, self._no_friction
        if self._limiting:
            limits = self._limits(motor)
        if self._rubbing or self.laws["drive"]:
            wanted = np.empty(pull.shape)
            within_limits(pull, self._servo[1], motor.velocity, limits, wanted)
            line = self._line(wanted, motor)
            friction = self._friction(joint, line[0] * wanted + line[1] if self.laws["drive"] else wanted, load)
        wound, spin = (motor.position - joint.position, self.spin) if self._gives else (self._zero, self.velocity)
        solution: np.ndarray[Any, Any] = np.empty((4, *pull.shape))
        state = joint.position, self.velocity, wound, spin, self._servo, limits, *self._fixed, self._impulse, solution
        if self._feels_external:  # then `_friction` has computed the bodies' inertia
            solve_step(*self._inertia, pull, load, line, friction, *state)
        else:
            step_joints(joint.velocity, *self._rigid, *self._inertia, pull, load, line, friction, *state)
        for _ in range(PASSES - 1 if self.laws["drive"] else 0):
            if not self._bent(solution[1], motor, line):
                break
            line = self._line(solution[1], motor)
            solve_step(*self._inertia, pull, load, line, friction, *state)
        acceleration, self.torque, self._impulse, turned = solution
        self._pass("drive", self.torque, motor)
        self._turn(turned, acceleration)
        return acceleration

    def _instant(self) -> tuple[JointState, JointState]:
        """State of joints and motors now, equal without compliant gears; velocities are extrapolated by half a step."""
        now = self.velocity + 0.5 * (self.velocity - self._before)
        self._before = self.velocity
        joint = JointState(self.position, now, self.torque, self.dt, self.time)
        if not self._gives:
            self.motor, self.spin = self.position, self.velocity
            return joint, joint
        self.motor = np.where(self._loose, self.motor, self.position)
        self.spin = np.where(self._loose, self.spin, self.velocity)
        now = self.spin + 0.5 * (self.spin - self._spun)
        self._spun = self.spin
        return joint, JointState(self.motor, now, self.torque, self.dt, self.time)

    def _turn(self, spin: np.ndarray, acceleration: np.ndarray) -> None:
        """Advance the motors with their new velocity (B, n)."""
        self.measured_acceleration = acceleration
        if self._gives:
            self.measured_acceleration = np.where(self._loose, (spin - self.spin) / self.dt, acceleration)
            self.spin = np.clip(spin, -FASTEST, FASTEST)
            self.motor = self.motor + self.spin * self.dt

    def _line(self, torque: np.ndarray, joint: JointState) -> np.ndarray:
        """Gain and shift (2, B, n) of the drive's laws, linearised at a torque (B, n) of the drive."""
        if not self.laws["drive"]:
            return self._straight
        given, step = self._try("drive", torque, joint), NUDGE * (1.0 + np.abs(torque))
        gain = np.maximum((self._try("drive", torque + step, joint) - given) / step, 0.0)
        return np.stack([gain, given - gain * torque])

    def _bent(self, torque: np.ndarray, joint: JointState, line: np.ndarray) -> bool:
        """Whether the drive's laws differ from their linearisation at a torque (B, n)."""
        given = self._try("drive", torque, joint)
        return bool(np.any(np.abs(given - line[0] * torque - line[1]) > STRAIGHT * (1.0 + np.abs(given))))

    def read(self) -> np.ndarray:
        """Sensor readings (B, n) at the current position; memories are not advanced."""
        seen = np.where(self._loose, self.motor, self.position) if self._gives else self.position
        joint = JointState(seen, self.velocity, self.torque, self.dt, self.time)
        return np.array(self._try("sensor", seen, joint), float)

    def clock_jitter(self) -> np.ndarray:
        """Standard deviation (B, arms), s, of the errors of a log's timestamps."""
        jitter, rest = np.zeros((self.batch, self.model.tree.arms)), np.zeros((self.batch, self.model.n))
        for law in self.laws["clock"]:
            joint = JointState(rest, rest, rest, self.dt, 0.0)
            jitter, _ = law.effect.law(jitter, joint, law.effect.start(jitter, law.p, self.dt), law.p)
        return jitter

    def advance(self, acceleration: np.ndarray) -> None:
        """Move freely for one step, as PyBullet would: v += a dt, q += v dt."""
        moved = np.empty((2, *self.position.shape))
        move(self.position, self.velocity, acceleration, self.dt, moved)
        self.position, self.velocity = moved[0], moved[1]
        self.time += self.dt

    def keep(self, rollouts: int) -> None:
        """Drop all but the first rollouts: the others have ended."""
        b = rollouts * self.sets
        self.rollouts, self.batch = rollouts, b
        for name in ("position", "velocity", "motor", "spin", "torque", "measured", "measured_acceleration", "_impulse",
                     "_before", "_spun", "_loose"):  # fmt: skip
            setattr(self, name, getattr(self, name)[:b])
        self._gear = np.ascontiguousarray(self._gear[:, :b])
        self._servo = np.ascontiguousarray(self._servo[:, :b])
        self._asked.keep(self._servo[1])
        self._neutral()
        laws = [law for laws in self.laws.values() for law in laws]
        for p in [*(law.p for law in laws), *(p for _, p in self.budgets)]:
            for key, value in vars(p).items():
                setattr(p, key, value[:b])
        for law in laws:
            law.memory = cut_memory(law.memory, b)

    def _pass(self, stage: str, signal: np.ndarray, joint: JointState) -> np.ndarray:
        for law in self.laws[stage]:
            signal, law.memory = law.effect.law(signal, joint, law.memory, law.p)
        return signal

    def _try(self, stage: str, signal: np.ndarray, joint: JointState) -> np.ndarray:
        """Output of a stage for a signal (B, n); memories are not advanced."""
        for law in self.laws[stage]:
            signal, _ = law.effect.law(signal, joint, law.memory, law.p)
        return signal

    def _limits(self, joint: JointState) -> np.ndarray:
        """The drive's limits (5, B, n) of all budgets together."""
        given = [limit for effect, p in self._limiting for limit in effect.drive(joint, p) or ()]
        if not _same(given, self._limited[0]):
            limits = self._unlimited.copy()
            for k, limit in enumerate(given):
                np.minimum(limits[k % 5], limit, out=limits[k % 5])
            self._limited = given, limits
        return self._limited[1]

    def _friction(self, joint: JointState, torque: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Friction forward and backward (2, B, n) of all budgets, for gears between a drive's torque and a load."""
        joint = JointState(joint.position, joint.velocity, torque, joint.dt, joint.time)
        if self._feels_external:
            motion = joint.position, joint.velocity
            self._inertia = self.model.bodies.mass_matrix_and_bias(*motion, self._masses)
            joint.external = load - self._inertia[1]
        given = [taken for effect, p in self._rubbing for taken in effect.friction(joint, p) or ()]
        if not _same(given, self._rubbed[0]):
            friction = self._no_friction.copy()
            for k, taken in enumerate(given):
                friction[k % 2] += taken
            self._rubbed = given, friction
        return self._rubbed[1]


def _same(a: Sequence[Any], b: Sequence[Any]) -> bool:
    """Whether two lists contain the same array objects; laws return new arrays if a value changes."""
    return len(a) == len(b) and all(map(is_, a, b))
