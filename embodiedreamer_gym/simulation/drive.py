"""The driven joints of a batch of robots: command path, servo, drive, mechanics, sensors, in this order."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import Effect, JointState, Mechanics, MechanicsChange, SignalLaw, TorqueBudget
from embodiedreamer_gym.effects.effect import STAGES
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.model import GRAVITY, SERVO_GROUPS
from embodiedreamer_gym.simulation.solve import end_stops, solve_step, tightened, within_limits

TIME_STEP = 1.0 / 240.0  # s, the environment's own
UNLIMITED = 1e12  # N m or rad/s
Sets = Mapping[str, np.ndarray]  # group ("stiffness", "payload.mass") -> (P, joints or arms)


class Drive:
    """Turns commands into joint accelerations; what fits simulate and what environments run.

    A batch holds P parameter sets for each of R rollouts, B = R * P samples, sample b = rollout * P + set.
    """

    def __init__(self, model: RobotModel, sets: Sets | None = None, rollouts: int = 1, dt: float = TIME_STEP) -> None:
        self.model, self.dt = model, dt
        sets = sets or {}
        self.sets = max((len(v) for v in sets.values()), default=1)
        self.rollouts = rollouts
        servo = {
            g: np.broadcast_to(sets[g] if g in sets else getattr(model, g), (self.sets, model.n)) for g in SERVO_GROUPS
        }
        values = [(effect, _values(effect, model, sets, self.sets)) for effect in model.effects]
        self.mechanics = _mechanics(model, servo["rotor_inertia"], values)
        servo["rotor_inertia"] = self.mechanics.rotor_inertia
        self._servo = {g: _tile(v, rollouts) for g, v in servo.items()}
        tiled = [(e, SimpleNamespace(**{k: _tile(v, rollouts) for k, v in p.items()})) for e, p in values]
        self._laws = {s: [(e, p) for e, p in tiled if isinstance(e, SignalLaw) and e.stage == s] for s in STAGES}
        self._budgets = [(e, p) for e, p in tiled if isinstance(e, TorqueBudget)]
        self._lower, self._upper = model.tree.lower, model.tree.upper
        self._blocks = _blocks(model.tree.arm)
        self.batch = self.sets * rollouts

    def start(self, measured: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> None:
        """Put the joints where the sensors (B, n) saw them, with all memories at rest at the first command."""
        self.velocity = np.array(velocity, float)
        self.time = 0.0
        self._memory: list[Any] = [None] * sum(len(laws) for laws in self._laws.values())
        self._index = {}
        for stage in STAGES:
            for law in self._laws[stage]:
                self._index[id(law[0])] = len(self._index)
        self._joint = JointState(measured, self.velocity, np.zeros_like(self.velocity), self.dt, 0.0)
        signals = {"command": command, "servo": np.zeros_like(command), "drive": np.zeros_like(command),
                   "load": np.zeros_like(command), "sensor": measured}  # fmt: skip
        for stage in STAGES:
            signal = np.array(signals[stage], float)
            for effect, p in self._laws[stage]:
                self._memory[self._index[id(effect)]] = effect.start(signal, p, self.dt)
                signal, _ = effect.law(signal, self._joint, effect.start(signal, p, self.dt), p)
            signals[stage] = signal
        self.position = 2 * measured - signals["sensor"]  # exact for an offset
        self._impulse = np.zeros_like(self.position)
        self._before = self.velocity
        self.torque = np.zeros_like(self.position)
        self.measured = np.array(measured, float)
        self._free = self._unlimited()

    def _unlimited(self) -> tuple[np.ndarray, ...]:
        """Friction's torque forward and backward, the drive's limits and the joints a law holds, where there are none."""
        shape = self.position.shape
        return np.zeros(shape), np.zeros(shape), np.full((5, *shape), UNLIMITED), np.zeros(shape, np.bool_)

    def accelerate(self, command: np.ndarray) -> np.ndarray:
        """Acceleration (B, n) of this step under the command (B, n); sets `measured` and `torque` of this instant."""
        position, velocity, dt = self.position, self.velocity, self.dt
        now = velocity + 0.5 * (velocity - self._before)  # the velocity belongs to half a step ago, its torques to now
        self._before = velocity
        joint = self._joint = JointState(position, now, self.torque, dt, self.time)
        self.measured = self._pass("sensor", position, joint)
        heard = self._pass("command", command, joint)
        error = self._pass("servo", heard - self.measured, joint)
        load = self._pass("load", self._free[0], joint)
        servo = self._servo
        pull = servo["stiffness"] * error
        forward, backward, limits, fixed = self._free
        if self._budgets:
            wanted = self.torque if self._laws["drive"] else pull - servo["damping"] * now
            forward, backward, limits = self._budget(joint, wanted)
        slowest, fastest = end_stops(position, self._lower, self._upper, dt)
        mass, bias = self.model.bodies.mass_matrix_and_bias(position, now, self.mechanics)
        acceleration, torque = np.empty_like(position), np.empty_like(position)
        impulse = self._impulse.copy()
        fixed_torque = torque

        def solve() -> None:
            solve_step(mass, bias, velocity, pull, servo["stiffness"], servo["damping"], servo["viscous_friction"],
                       servo["rotor_inertia"], load, fixed, fixed_torque, limits, forward, backward, slowest, fastest,
                       self._blocks, dt, impulse, acceleration, torque)  # fmt: skip

        solve()
        if self._laws["drive"]:
            given = self._pass("drive", torque.copy(), joint)
            fixed = np.abs(given - torque) > 1e-12
            if fixed.any():  # a torque that a law has changed no longer carries the servo's damping
                impulse = self._impulse.copy()
                fixed_torque = given
                solve()
        self._impulse, self.torque = impulse, torque
        return acceleration

    def read(self) -> np.ndarray:
        """What the sensors (B, n) see of the present position; no memory moves on."""
        joint = JointState(self.position, self.velocity, self.torque, self.dt, self.time)
        signal = self.position
        for effect, p in self._laws["sensor"]:
            signal, _ = effect.law(signal, joint, self._memory[self._index[id(effect)]], p)
        return np.array(signal, float)

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
        for name in ("position", "velocity", "torque", "measured", "_impulse", "_before"):
            setattr(self, name, getattr(self, name)[:b])
        self._free = self._unlimited()
        self._servo = {k: v[:b] for k, v in self._servo.items()}
        for _, p in [*(law for laws in self._laws.values() for law in laws), *self._budgets]:
            for key, value in vars(p).items():
                setattr(p, key, value[:b])
        self._memory = [_cut(m, b) for m in self._memory]

    def _pass(self, stage: str, signal: np.ndarray, joint: JointState) -> np.ndarray:
        for effect, p in self._laws[stage]:
            i = self._index[id(effect)]
            signal, self._memory[i] = effect.law(signal, joint, self._memory[i], p)
        return signal

    def _budget(self, joint: JointState, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Friction's torque forward and backward (B, n), and the drive's limits (5, B, n), of all budgets together.

        wanted: the servo's torque (B, n) at this instant; what the limits leave of it loads the gears.
        """
        forward, backward, limits, _ = self._free
        shape = joint.position.shape
        for effect, p in self._budgets:
            given = effect.drive(joint, p)
            if given is not None:
                limits = tightened(limits, tuple(x if x.shape == shape else _spread(x, shape) for x in given))
        limited = within_limits(wanted, joint.velocity, limits)
        joint = JointState(joint.position, joint.velocity, limited, joint.dt, joint.time)
        for effect, p in self._budgets:
            taken = effect.friction(joint, p)
            if taken is not None:
                forward, backward = forward + taken[0], backward + taken[1]
        return forward, backward, limits


def _spread(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(values, shape))


def _tile(values: np.ndarray, rollouts: int) -> np.ndarray:
    """Values (P, m) once for each rollout, in C order: each memory layout would be compiled on its own."""
    return np.ascontiguousarray(np.tile(values, (rollouts, 1)))


def _values(effect: Effect, model: RobotModel, sets: Sets, count: int) -> dict[str, np.ndarray]:
    """An effect's parameters as arrays (P, joints or arms): what the sets give, else the model's own values."""
    arrays = {}
    for p in effect.parameters:
        names = model.joints if p.per == "joint" else model.arms
        own = model.parameter_off(p).copy()
        for name, value in effect.values[p.name].items():
            own[names.index(name)] = value
        values = np.array(np.broadcast_to(sets.get(f"{effect.name}.{p.name}", own), (count, len(names))))
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
