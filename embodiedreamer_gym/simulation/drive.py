"""The driven joints of a batch of robots: command path, servo, drive, mechanics, sensors, in this order."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import Effect, JointState, Mechanics, MechanicsChange, SignalLaw, TorqueBudget
from embodiedreamer_gym.effects.effect import STAGES
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.robot.data import GRAVITY, SERVO_GROUPS
from embodiedreamer_gym.robot.parameters import by_key
from embodiedreamer_gym.simulation.joint_solver import end_stops, solve_step, tightened, within_limits

TIME_STEP = 1.0 / 240.0  # s, the environment's own
UNLIMITED = 1e12  # N m or rad/s
SAGS = 3  # passes to the rest of joints that hang on gears that give way
PASSES = 2  # over a law of the drive that is no line
NUDGE, STRAIGHT = 1e-4, 1e-6  # relative torque by which its slope is felt out, and by which it may differ from a line
# group of parameters, or its text form ("stiffness", "payload.mass") -> values (P, joints or arms)
Sets = Mapping[str, np.ndarray] | Mapping[ParameterKey, np.ndarray]


class Drive:
    """Turns commands into joint accelerations; what fits simulate and what environments run.

    A batch holds P parameter sets for each of R rollouts, B = R * P samples, sample b = rollout * P + set.
    """

    def __init__(self, model: RobotModel, sets: Sets | None = None, rollouts: int = 1, dt: float = TIME_STEP) -> None:
        self.model, self.dt = model, dt
        values = by_key(sets or {})
        self.sets = max((len(v) for v in values.values()), default=1)
        self.rollouts = rollouts
        servo = {
            g: np.broadcast_to(values.get(ParameterKey(g), model.group_values(ParameterKey(g))), (self.sets, model.n))
            for g in SERVO_GROUPS
        }
        effects = [(effect, _values(effect, model, values, self.sets)) for effect in model.effects]
        self.mechanics = _mechanics(model, servo["rotor_inertia"], effects)
        servo["rotor_inertia"] = self.mechanics.rotor_inertia
        self.servo = {g: _tile(v, rollouts) for g, v in servo.items()}
        tiled = [(e, SimpleNamespace(**{k: _tile(v, rollouts) for k, v in p.items()})) for e, p in effects]
        self.laws = {s: [(e, p) for e, p in tiled if isinstance(e, SignalLaw) and e.stage == s] for s in STAGES}
        self.budgets = [(e, p) for e, p in tiled if isinstance(e, TorqueBudget)]
        self._gear = _gear(self.mechanics, self.sets, model.n, rollouts)
        self._gives = self._gear.shape[1] > 0
        self._loose = self._gear[0] + self._gear[2] > 0.0
        self._lower, self._upper = model.tree.lower, model.tree.upper
        self._blocks = _blocks(model.tree.arm)
        self.batch = self.sets * rollouts

    def start(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> None:
        """Put the joints where the sensors (B, n) saw them, with all memories at rest at the first command."""
        self.velocity = np.array(velocity, float)
        self.time = 0.0
        self._memory: list[Any] = [None] * sum(len(laws) for laws in self.laws.values())
        self._index = {}
        for stage in STAGES:
            for law in self.laws[stage]:
                self._index[id(law[0])] = len(self._index)
        self._joint = JointState(measured, self.velocity, np.zeros_like(self.velocity), self.dt, 0.0)
        self.measured = np.array(measured, float)
        self._joint.position = self.position = 2 * measured - self._begin("sensor", measured)  # exact for an offset
        pull = self.servo["stiffness"] * self._begin("servo", self._begin("command", command) - measured)
        surplus = self._begin("drive", pull) - self._weight()
        load = self._begin("load", surplus) - surplus
        self.motor, self.spin = self.position, self.velocity
        for _ in range(SAGS if self._gives else 0):
            carried = self._weight() - load
            self.position = self.motor - self._gear[0] * carried - self._gear[2] * np.sign(carried)
        self._impulse = np.zeros_like(self.position)
        self._before, self._spun = self.velocity, self.spin
        self.torque = self.measured_acceleration = np.zeros_like(self.position)
        self._free = self._unlimited()

    def _weight(self) -> np.ndarray:
        """Torque (B, n) that holds the joints where they are."""
        still = np.zeros_like(self.position)
        return self.model.bodies.mass_matrix_and_bias(self.position, still, self.mechanics)[1]

    def _begin(self, stage: str, signal: np.ndarray) -> np.ndarray:
        """Put a stage's memories at rest at its first signal (B, n); what the stage makes of that signal."""
        signal = np.array(signal, float)
        for effect, p in self.laws[stage]:
            self._memory[self._index[id(effect)]] = memory = effect.start(signal, p, self.dt)
            signal, _ = effect.law(signal, self._joint, memory, p)
        return signal

    def _unlimited(self) -> tuple[np.ndarray, ...]:
        """Without friction, limits and laws of the drive: torques, limits, the share of a torque that arrives, and a shift."""
        shape = self.position.shape
        return np.zeros(shape), np.zeros(shape), np.full((5, *shape), UNLIMITED), np.ones(shape), np.zeros(shape)

    def accelerate(self, command: np.ndarray) -> np.ndarray:
        """Acceleration (B, n) of this step under the command (B, n); sets `measured` and `torque` of this instant.

        torque is the drive's before its laws: the one its current stands for. What the sensors see accelerates by
        `measured_acceleration`, which is the motor's where a gear gives way.
        """
        joint, motor = self._instant()
        self.measured = self._pass("sensor", motor.position, motor)
        heard = self._pass("command", command, motor)
        servo = self.servo
        pull = servo["stiffness"] * self._pass("servo", heard - self.measured, motor)
        load = self._pass("load", self._free[0], joint)
        forward, backward, limits, gain, shift = self._free
        if self.budgets or self.laws["drive"]:
            limits = self._limits(motor)
            wanted = within_limits(pull - servo["damping"] * motor.velocity, motor.velocity, limits)
            gain, shift = self._line(wanted, motor)
            forward, backward = self._friction(joint, gain * wanted + shift if self.laws["drive"] else wanted)
        slowest, fastest = end_stops(joint.position, self._lower, self._upper, self.dt)
        mass, bias = self.model.bodies.mass_matrix_and_bias(joint.position, joint.velocity, self.mechanics)
        acceleration, torque = np.empty_like(bias), np.empty_like(bias)
        wound = motor.position - joint.position if self._gives else self._free[0]
        impulse, spin = self._impulse, self.velocity
        for _ in range(PASSES):
            impulse, spin = self._impulse.copy(), self.spin.copy() if self._gives else spin
            solve_step(mass, bias, self.velocity, pull, servo["stiffness"], servo["damping"], servo["viscous_friction"],
                       servo["rotor_inertia"], gain, shift, load, limits, forward, backward, slowest, fastest,
                       self._gear, wound, spin, self._blocks, self.dt, impulse, acceleration, torque)  # fmt: skip
            if not self._bent(torque, motor, gain, shift):
                break
            gain, shift = self._line(torque, motor)
        self._pass("drive", torque, motor)
        self._impulse, self.torque = impulse, torque
        self._turn(spin, acceleration)
        return acceleration

    def _instant(self) -> tuple[JointState, JointState]:
        """The joints and the motors now, whose velocities belong to half a step ago; the same where no gear gives way."""
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
        """Move the motors on by their new velocity (B, n)."""
        self.measured_acceleration = acceleration
        if self._gives:
            self.measured_acceleration = np.where(self._loose, (spin - self.spin) / self.dt, acceleration)
            self.spin = np.clip(spin, -1e3, 1e3)
            self.motor = self.motor + self.spin * self.dt

    def _line(self, torque: np.ndarray, joint: JointState) -> tuple[np.ndarray, np.ndarray]:
        """What arrives at the joints of a drive's torque about this one (B, n): the gain and shift of a line."""
        if not self.laws["drive"]:
            return self._free[3], self._free[4]
        given, step = self._try("drive", torque, joint), NUDGE * (1.0 + np.abs(torque))
        gain = np.maximum((self._try("drive", torque + step, joint) - given) / step, 0.0)
        return gain, given - gain * torque

    def _bent(self, torque: np.ndarray, joint: JointState, gain: np.ndarray, shift: np.ndarray) -> bool:
        """Whether the drive's laws give something else at a torque (B, n) than their line."""
        if not self.laws["drive"]:
            return False
        given = self._try("drive", torque, joint)
        return bool(np.any(np.abs(given - gain * torque - shift) > STRAIGHT * (1.0 + np.abs(given))))

    def read(self) -> np.ndarray:
        """What the sensors (B, n) see of the present position; no memory moves on."""
        seen = np.where(self._loose, self.motor, self.position) if self._gives else self.position
        joint = JointState(seen, self.velocity, self.torque, self.dt, self.time)
        return np.array(self._try("sensor", seen, joint), float)

    def clock_jitter(self) -> np.ndarray:
        """Standard deviation (B, arms), s, of the errors of a log's time stamps."""
        jitter, rest = np.zeros((self.batch, self.model.tree.arms)), np.zeros((self.batch, self.model.n))
        for effect, p in self.laws["clock"]:
            joint = JointState(rest, rest, rest, self.dt, 0.0)
            jitter, _ = effect.law(jitter, joint, effect.start(jitter, p, self.dt), p)
        return jitter

    def advance(self, acceleration: np.ndarray) -> None:
        """Move freely for one step, as PyBullet would: v += a dt, q += v dt."""
        self.velocity = self.velocity + acceleration * self.dt
        np.clip(self.velocity, -1e3, 1e3, out=self.velocity)
        self.position = self.position + self.velocity * self.dt
        self.time += self.dt

    def keep(self, rollouts: int) -> None:
        """Drop all but the first rollouts: the others have ended."""
        b = rollouts * self.sets
        self.rollouts, self.batch = rollouts, b
        for name in ("position", "velocity", "motor", "spin", "torque", "measured", "measured_acceleration", "_impulse",
                     "_before", "_spun", "_loose"):  # fmt: skip
            setattr(self, name, getattr(self, name)[:b])
        self._gear = np.ascontiguousarray(self._gear[:, :b])
        self._free = self._unlimited()
        self.servo = {k: v[:b] for k, v in self.servo.items()}
        for _, p in [*(law for laws in self.laws.values() for law in laws), *self.budgets]:
            for key, value in vars(p).items():
                setattr(p, key, value[:b])
        self._memory = [_cut(m, b) for m in self._memory]

    def _pass(self, stage: str, signal: np.ndarray, joint: JointState) -> np.ndarray:
        for effect, p in self.laws[stage]:
            i = self._index[id(effect)]
            signal, self._memory[i] = effect.law(signal, joint, self._memory[i], p)
        return signal

    def _try(self, stage: str, signal: np.ndarray, joint: JointState) -> np.ndarray:
        """What a stage makes of a signal (B, n); no memory moves on."""
        for effect, p in self.laws[stage]:
            signal, _ = effect.law(signal, joint, self._memory[self._index[id(effect)]], p)
        return signal

    def _limits(self, joint: JointState) -> np.ndarray:
        """The drive's limits (5, B, n) of all budgets together."""
        limits, shape = self._free[2], joint.position.shape
        for effect, p in self.budgets:
            given = effect.drive(joint, p)
            if given is not None:
                limits = tightened(limits, tuple(x if x.shape == shape else _spread(x, shape) for x in given))
        return limits

    def _friction(self, joint: JointState, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Friction's torque forward and backward (B, n) of all budgets, the gears loaded by a torque (B, n)."""
        forward, backward = self._free[:2]
        joint = JointState(joint.position, joint.velocity, torque, joint.dt, joint.time)
        for effect, p in self.budgets:
            taken = effect.friction(joint, p)
            if taken is not None:
                forward, backward = forward + taken[0], backward + taken[1]
        return forward, backward


def _gear(mechanics: Mechanics, sets: int, n: int, rollouts: int) -> np.ndarray:
    """Compliance, settling time and half the gap (3, B, n) between motors and joints; of no samples where none gives."""
    parts = mechanics.compliance, mechanics.settling, mechanics.gap / 2
    if not (mechanics.compliance.any() or mechanics.gap.any()):
        return np.zeros((3, 0, 0))
    return np.stack([_tile(np.broadcast_to(part, (sets, n)), rollouts) for part in parts])


def _spread(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(values, shape))


def _tile(values: np.ndarray, rollouts: int) -> np.ndarray:
    """Values (P, m) once for each rollout, in C order: each memory layout would be compiled on its own."""
    return np.ascontiguousarray(np.tile(values, (rollouts, 1)))


def _values(
    effect: Effect, model: RobotModel, sets: Mapping[ParameterKey, np.ndarray], count: int
) -> dict[str, np.ndarray]:
    """An effect's parameters as arrays (P, joints or arms): what the sets give, else the model's own values."""
    arrays = {}
    for p in effect.parameters:
        key = ParameterKey(p.name, effect.name)
        own = model.group_values(key)
        values = np.array(np.broadcast_to(sets.get(key, own), (count, len(own))))
        if p.off == p.high:  # a limit that is off is none
            values[values >= model.parameter_off(p) * (1 - 1e-9)] = np.inf
        arrays[p.name] = values
    return arrays


def _blocks(arm: np.ndarray) -> np.ndarray:
    """First joint of each arm, then n; one block when the arms' joints are not in a row."""
    starts = [0, *(np.flatnonzero(np.diff(arm)) + 1).tolist()]
    if len(starts) > len(np.unique(arm)):
        starts = [0]
    return np.array([*starts, len(arm)], np.int64)


def _mechanics(model: RobotModel, rotor_inertia: np.ndarray, values) -> Mechanics:
    """The rigid bodies of P parameter sets, after all changes of mechanics."""
    count = len(rotor_inertia)
    changes = [(e, p) for e, p in values if isinstance(e, MechanicsChange)]
    nominal = model.nominal_mechanics
    many = count if changes else 1
    mechanics = Mechanics(
        *(np.repeat(x, many, axis=0) for x in (nominal.mass, nominal.first_moment, nominal.inertia)),
        gravity=np.broadcast_to(GRAVITY, (many, model.tree.arms, 3)).copy(),
        rotor_inertia=np.array(rotor_inertia),
        tip_body=nominal.tip_body,
        tip_point=nominal.tip_point,
    )
    for effect, p in changes:
        effect.change(mechanics, SimpleNamespace(**p))
    return mechanics


def _cut(memory: Any, batch: int) -> Any:
    """Keep the first samples of a memory: arrays (B, ...), or tuples and dicts of them."""
    if isinstance(memory, np.ndarray) and memory.ndim:
        return memory[:batch]
    if isinstance(memory, tuple):
        return tuple(_cut(m, batch) for m in memory)
    if isinstance(memory, dict):
        return {k: _cut(m, batch) for k, m in memory.items()}
    return memory
