"""Inputs for the tests of effects' laws: seeded parameter sets, motions and bodies."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace

import numpy as np

from embodiedreamer_gym.effects.effect import PER, Array, Effect, JointState, Mechanics, ServoState

N, ARMS, BODIES = 3, 2, 5
SETS, OFF, TYPICAL = 7, slice(0, 2), 4  # sets: off, off except for shapes, low, high, typical, two at random
EVERY = slice(None)
STEPS, DT = 24, 1 / 240  # s
BY_JOINT = ("compliance", "settling", "gap")  # fields of a Mechanics that broadcast
Sets = dict[str, Array]  # parameter -> (B, joints or arms)


def parameter_sets(kind: type[Effect], rng: np.random.Generator) -> Sets:
    """Values of every parameter at its ends, its typical size, off and at random; a limit that is off is infinite."""
    sets = {}
    for p in kind.parameters:
        values = rng.uniform(p.low, p.high, (SETS, N if p.per == "joint" else ARMS))
        values[2:5] = np.array([p.low, p.high, p.typical])[:, None]
        values[: 1 if p.shape and not p.is_limit else 2] = p.off
        if p.is_limit:
            values[values >= p.off * (1 - 1e-9)] = np.inf
        sets[p.name] = values
    return sets


def given(sets: Sets, rows: slice = EVERY) -> SimpleNamespace:
    """Rows of parameter sets in the form that a law receives; they are read-only."""
    return SimpleNamespace(**{name: locked(values[rows]) for name, values in sets.items()})


def locked(array: Array) -> Array:
    """A read-only copy."""
    array = np.array(array)
    array.setflags(write=False)
    return array


class Motion:
    """Sinusoidal motion of the joints and signal: arrays (S, B, n), up to about 10 rad/s and 3 N m.

    If a stage's signal is per arm, it is the size of an error: (S, B, arms), not negative. external: whether there is
    an external torque on the joints.
    """

    def __init__(self, rng: np.random.Generator, stage: str = "", external: bool = False) -> None:
        self.stage = stage
        time, shape = DT * np.arange(STEPS)[:, None, None], (SETS, N)
        rate, phase = rng.uniform(10.0, 40.0, (3, *shape)), rng.uniform(0.0, 6.28, (3, *shape))
        size = rng.uniform(0.02, 0.4, shape)
        self.position = rng.uniform(-0.5, 0.5, shape) + size * np.sin(rate[0] * time + phase[0])
        self.velocity = size * rate[0] * np.cos(rate[0] * time + phase[0])
        self.torque = 3.0 * np.sin(rate[1] * time + phase[1])
        self.external = 2.0 * np.sin(rate[0] * time + phase[1]) if external else None
        self.signal = np.sin(rate[2] * time + phase[2])
        if PER.get(stage) == "arm":
            self.signal = np.abs(self.signal[..., :ARMS])

    def joint(self, k: int, rows: slice = EVERY) -> JointState:
        """State of the joints at a step."""
        position, velocity, torque = (locked(x[k, rows]) for x in (self.position, self.velocity, self.torque))
        external = None if self.external is None else locked(self.external[k, rows])
        if self.stage != "torque":
            return JointState(position, velocity, torque, DT, k * DT, external)
        pull, speed = locked(self.signal[k, rows]), locked(velocity + 0.1)
        damping, weight = locked(np.full_like(pull, 0.5)), locked(np.cos(position))
        return ServoState(position, velocity, torque, DT, k * DT, pull=pull, damping=damping, command_velocity=speed,
                          weigh=lambda _: weight)  # fmt: skip


def ordinary_bodies(batch: int) -> Mechanics:
    """Two arms of ordinary links with rotors; all robots of a batch are equal."""
    rng = np.random.default_rng(1)
    mass, centre = rng.uniform(0.5, 2.0, (1, BODIES)), rng.uniform(-0.1, 0.1, (1, BODIES, 3))
    square = np.einsum("bki,bki->bk", centre, centre)[..., None, None] * np.eye(3)
    inertia = mass[..., None, None] * (square - centre[..., :, None] * centre[..., None, :] + 0.003 * np.eye(3))
    parts = (mass, mass[..., None] * centre, inertia, np.tile([0.0, 0.0, -9.81], (1, ARMS, 1)), np.full((1, N), 0.05))
    return Mechanics(*(np.repeat(x, batch, axis=0) for x in parts), tip_body=np.array([1, BODIES - 1]),
                     tip_point=np.array([[0.1, 0.0, 0.05], [0.0, 0.15, 0.0]]))  # fmt: skip


def arrays(mechanics: Mechanics, batch: int) -> dict[str, Array]:
    """Field -> array with the robots first; fields that broadcast are expanded."""
    fields_by_name = {
        f.name: np.asarray(getattr(mechanics, f.name), float) for f in fields(Mechanics) if f.name[:3] != "tip"
    }
    for name in BY_JOINT:
        if np.broadcast_shapes(fields_by_name[name].shape, (batch, N)) == (batch, N):
            fields_by_name[name] = np.broadcast_to(fields_by_name[name], (batch, N))
    return fields_by_name


def spatial_inertia(fields_by_name: dict[str, Array]) -> Array:
    """Mass, centre and inertia of bodies as one matrix (B, k, 6, 6), which is positive for every real body."""
    mass, moment = fields_by_name["mass"], fields_by_name["first_moment"]
    cross = np.zeros((*mass.shape, 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -moment[..., 2], moment[..., 1], -moment[..., 0]
    cross = cross - cross.swapaxes(-1, -2)
    whole = np.zeros((*mass.shape, 6, 6))
    whole[..., :3, :3], whole[..., 3:, 3:] = fields_by_name["inertia"], mass[..., None, None] * np.eye(3)
    whole[..., :3, 3:], whole[..., 3:, :3] = cross, cross.swapaxes(-1, -2)
    return whole
