"""Tests of the laws that every effect must obey, on seeded motions in milliseconds; a user's file must pass them."""

from __future__ import annotations

import copy
from typing import Any, NoReturn

import numpy as np

from embodiedreamer_gym.effects.declaration import faults
from embodiedreamer_gym.effects.effect import Array, Effect, JointState, MechanicsChange, SignalLaw, TorqueBudget
from embodiedreamer_gym.effects.trial import (
    ARMS,
    BY_JOINT,
    DT,
    EVERY,
    OFF,
    SETS,
    STEPS,
    TYPICAL,
    Motion,
    N,
    Sets,
    arrays,
    given,
    locked,
    ordinary_bodies,
    parameter_sets,
    spatial_inertia,
)
from embodiedreamer_gym.errors import EffectError

CYCLES = (40, 240)  # steps of a cycle: 6 and 1 Hz
AMPLITUDES = (0.01, 0.1, 1.0)  # rad
RETURNED = 1e-3  # tolerance relative to the total work over a cycle, for rounding errors
UNLIMITED = 1e6  # N m or rad/s; beyond any drive
CLOSE = 1e-9


def check_laws(kind: type[Effect]) -> None:
    """Check an effect against the laws: declaration, shape, finite, off, passive, pure, batch, rest, memory, mechanics.

    Raises: EffectError, one sentence that names the effect and the first law that it violates.
    """
    try:
        for fault in faults(kind):
            _refuse(kind, fault, "declaration")
        rng = np.random.default_rng(0)
        with np.errstate(all="ignore"):
            effect, sets = kind(), parameter_sets(kind, rng)
            if isinstance(effect, SignalLaw):
                _check_signal(effect, sets, Motion(rng, effect.stage))
            elif isinstance(effect, TorqueBudget):
                _check_budget(effect, sets, Motion(rng, external=effect.feels_external))
            elif isinstance(effect, MechanicsChange):
                _check_mechanics(effect, sets)
    except EffectError:
        raise
    except Exception as error:  # report any exception of a user's law as one sentence
        text = " ".join(str(error).split()).rstrip(".")
        if "read-only" in text:
            _refuse(kind, "changes its input in place; return a new array", "pure")
        tried = f"{SETS} sets of parameters, {N} joints and {ARMS} arms"
        _refuse(kind, f"fails when tried on {tried}: {type(error).__name__}: {text}", "shape")


def _refuse(effect: type[Effect] | Effect, what: str, law: str) -> NoReturn:
    name = getattr(effect, "name", None) or getattr(effect, "__name__", "")
    raise EffectError(f"effect {name} {what} (law '{law}').")


def _check_same(effect: Effect, arguments: Any, before: dict[str, Any]) -> None:
    if any(vars(arguments).get(name) is not value for name, value in before.items()):
        _refuse(effect, "changes its input in place; return a new array", "pure")


def _check_repeats(effect: Effect, same: bool) -> None:
    if not same:
        _refuse(effect, "is not deterministic: it draws random numbers or keeps state outside its memory", "pure")


def _check_alone(effect: Effect, same: bool) -> None:
    if not same:
        _refuse(
            effect, "mixes its parameter sets: a set gives a different result alone than in a batch (B, n)", "batch"
        )


# ---- signal laws ----------------------------------------------------------------------------------------------------


def _check_signal(effect: SignalLaw, sets: Sets, motion: Motion) -> None:
    out = _play(effect, motion, sets)
    if not np.isfinite(out).all():
        _refuse(effect, "returns NaN or inf for ordinary inputs; a limit that is off reaches it as np.inf", "finite")
    if np.abs(out - motion.signal)[:, OFF].max() > CLOSE:
        _refuse(effect, "is not the identity when its parameters are off", "off")
    _check_repeats(effect, np.array_equal(out, _play(effect, motion, sets)))
    for b in range(SETS):
        rows = slice(b, b + 1)
        _check_alone(effect, np.allclose(out[:, rows], _play(effect, motion, sets, rows), rtol=CLOSE, atol=CLOSE))
    if effect.stage == "command":
        _check_rest(effect, sets, motion)
    for steps in CYCLES if effect.passive else ():
        _check_cycle(effect, sets, steps)


def _play(effect: SignalLaw, motion: Motion, sets: Sets, rows: slice = EVERY) -> Array:
    """Return the law's output (S, B, n) for a motion's signal, step by step; raises EffectError for a bad step."""
    p = given(sets, rows)
    parameters = dict(vars(p))
    memory = effect.start(locked(motion.signal[0, rows]), p, DT)
    out = []
    for k in range(STEPS):
        signal, joint = locked(motion.signal[k, rows]), motion.joint(k, rows)
        state = dict(vars(joint))
        _check_memory(effect, memory, len(signal))
        kept = copy.deepcopy(memory)
        answer: Any = effect.law(signal, joint, memory, p)
        if not isinstance(answer, tuple) or len(answer) != 2:
            _refuse(effect, "returns something other than (signal, memory)", "shape")
        if np.shape(answer[0]) != signal.shape:
            _refuse(effect, f"returns shape {np.shape(answer[0])} for a signal {signal.shape}", "shape")
        _check_same(effect, joint, state)
        _check_same(effect, p, parameters)
        if not _equal(kept, memory):
            _refuse(effect, "changes its memory in place; return a new one", "pure")
        out.append(np.array(answer[0], float))
        memory = answer[1]
    return np.array(out)


def _check_memory(effect: SignalLaw, memory: Any, batch: int) -> None:
    """Check that a simulation can reduce a memory to fewer rows."""
    if isinstance(memory, tuple | dict):
        for part in memory.values() if isinstance(memory, dict) else memory:
            _check_memory(effect, part, batch)
    elif isinstance(memory, np.ndarray) and memory.ndim and len(memory) != batch:
        _refuse(
            effect,
            f"keeps a memory of shape {memory.shape} for {batch} parameter sets; its first axis must be "
            "the parameter sets",
            "memory",
        )
    elif not isinstance(memory, np.ndarray | np.generic | int | float | None):
        allowed = "allowed are arrays, numbers, tuples and dicts"
        _refuse(effect, f"keeps a {type(memory).__name__} in its memory; {allowed}", "memory")


def _equal(a: Any, b: Any) -> bool:
    if a is b:
        return True
    if isinstance(a, tuple):
        return all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    return np.array_equal(a, b, equal_nan=True)


def _check_rest(effect: SignalLaw, sets: Sets, motion: Motion) -> None:
    """Check that the memory stays as it started while the command stands still."""
    p, signal, still = given(sets), locked(motion.signal[0]), locked(0 * motion.signal[0])
    memory = effect.start(signal, p, DT)
    first = None
    for k in range(STEPS if memory is not None else 0):
        out, memory = effect.law(signal, JointState(signal, still, still, DT, k * DT), memory, p)
        first = np.array(out) if first is None else first
        if np.abs(out - first).max() > CLOSE:
            _refuse(effect, "moves while its command stands still; let start put the memory at rest", "rest")


def _check_cycle(effect: SignalLaw, sets: Sets, steps: int) -> None:
    """Check the work over the second of two equal cycles of motion: only energy stored in a spring is returned."""
    count = SETS * len(AMPLITUDES)
    p = given({name: np.repeat(values, len(AMPLITUDES), axis=0) for name, values in sets.items()})
    size = np.tile(AMPLITUDES, SETS)[:, None]
    lead = np.arange(N) * (steps // 5)  # whole steps, so that the return passes the same points
    none = locked(np.zeros((count, N)))
    memory = effect.start(none, p, DT)
    work, moved, last = np.zeros(count), np.zeros(count), (none, none)
    for k in range(2 * steps + 1):
        angle = 2 * np.pi * (k + lead) / steps
        position = 0.3 * np.arange(N) + size * np.sin(angle)
        velocity = size * np.cos(angle) * 2 * np.pi / (steps * DT)
        torque, memory = effect.law(none, JointState(position, velocity, none, DT, k * DT), memory, p)
        if k > steps:
            done = (torque + last[1]) / 2 * (position - last[0])
            work, moved = work + done.sum(axis=1), moved + np.abs(done).sum(axis=1)
        last = position, torque
    if np.any(work > RETURNED * moved + 1e-12):
        _refuse(effect, "gives energy: over a cycle of motion it does more work than it takes", "passive")


# ---- torque budgets -------------------------------------------------------------------------------------------------


def _check_budget(effect: TorqueBudget, sets: Sets, motion: Motion) -> None:
    for k in range(0, STEPS, 3):
        both = _budgets(effect, motion, sets, k)
        friction, drive = both[:2], both[2:]
        if not np.isfinite(friction).all() or np.isnan(drive).any():
            _refuse(effect, "returns NaN or inf for ordinary inputs; only a limit of the drive may be np.inf", "finite")
        if friction.min() < 0:
            _refuse(effect, "gives energy: its friction pushes along the motion; a budget is never negative", "passive")
        if drive.min() < 0:
            _refuse(effect, "gives energy: a limit of its drive is negative", "passive")
        if np.abs(friction[:, OFF]).max() > CLOSE or drive[:, OFF].min() < UNLIMITED:
            _refuse(effect, "is not the identity when its parameters are off: no friction, limits of np.inf", "off")
        _check_repeats(effect, np.array_equal(both, _budgets(effect, motion, sets, k)))
        for b in range(SETS):
            rows = slice(b, b + 1)
            alone = _budgets(effect, motion, sets, k, rows)
            _check_alone(effect, np.allclose(alone, both[:, rows], rtol=CLOSE, atol=CLOSE))


def _budgets(effect: TorqueBudget, motion: Motion, sets: Sets, k: int, rows: slice = EVERY) -> Array:
    """Friction forward and backward, then the five limits of the drive (7, B, n), at a step of the motion."""
    p, joint = given(sets, rows), motion.joint(k, rows)
    state, parameters, shape = dict(vars(joint)), dict(vars(p)), joint.position.shape
    parts: list[Array] = []
    for name, count, none in (("friction", 2, 0.0), ("drive", 5, np.inf)):
        answer = getattr(effect, name)(joint, p)
        answer = (np.full(shape, none),) * count if answer is None else answer
        if not isinstance(answer, tuple) or len(answer) != count:
            _refuse(effect, f"returns as {name} something other than a tuple of {count} arrays", "shape")
        for values in answer:
            if np.broadcast_shapes(np.shape(values), shape) != shape:
                _refuse(effect, f"returns shape {np.shape(values)} as {name} of joints {shape}", "shape")
            parts.append(np.broadcast_to(values, shape))
    _check_same(effect, joint, state)
    _check_same(effect, p, parameters)
    return np.array(parts, float)


# ---- changes of mechanics -------------------------------------------------------------------------------------------


def _check_mechanics(effect: MechanicsChange, sets: Sets) -> None:
    nominal, changed = arrays(ordinary_bodies(SETS), SETS), _change(effect, sets)
    for name, values in changed.items():
        if values.shape != nominal[name].shape:
            _refuse(effect, f"leaves the {name} with shape {values.shape}, not {nominal[name].shape}", "shape")
        if not np.isfinite(values).all():
            _refuse(effect, f"makes the {name} NaN or inf", "finite")
        counts = changed["compliance"][OFF] > 0 if name == "settling" else np.array(True)
        if np.any(counts & (np.abs(values - nominal[name])[OFF] > CLOSE)):
            _refuse(effect, f"is not the identity when its parameters are off: it changes the {name}", "off")
    for name in ("mass", "rotor_inertia", *BY_JOINT):
        if changed[name].min() < 0:
            _refuse(effect, f"makes the {name} negative inside its bounds", "mechanics")
    inertia = changed["inertia"]
    if np.abs(inertia - inertia.swapaxes(-1, -2)).max() > CLOSE:
        _refuse(effect, "makes an inertia that is not symmetric", "mechanics")
    if np.linalg.eigvalsh(inertia).min() < -CLOSE:
        _refuse(effect, "makes an inertia negative inside its bounds", "mechanics")
    if np.linalg.eigvalsh(spatial_inertia(changed)[TYPICAL]).min() < -CLOSE:
        cause = "about the centre of mass: it moves mass without its inertia, see Mechanics.add_point_mass"
        _refuse(effect, f"makes an inertia negative {cause}", "mechanics")
    again = _change(effect, sets)
    _check_repeats(effect, all(np.array_equal(changed[name], again[name]) for name in changed))
    for b in range(SETS):
        alone = _change(effect, sets, slice(b, b + 1))
        same = [np.allclose(alone[name][0], changed[name][b], rtol=CLOSE, atol=CLOSE) for name in changed]
        _check_alone(effect, all(same))


def _change(effect: MechanicsChange, sets: Sets, rows: slice = EVERY) -> dict[str, Array]:
    """The bodies' fields after the change."""
    p = given(sets, rows)
    parameters = dict(vars(p))
    batch = len(next(iter(parameters.values())))
    mechanics = ordinary_bodies(batch)
    effect.change(mechanics, p)
    _check_same(effect, p, parameters)
    return arrays(mechanics, batch)
