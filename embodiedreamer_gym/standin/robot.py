"""The stand-in for a real robot: an arm in MuJoCo with hidden faults, which records logs."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from embodiedreamer_gym.errors import ModelError, RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.motions import Motion
from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.robot.urdf import read_xml
from embodiedreamer_gym.standin.engine import Engine
from embodiedreamer_gym.standin.hidden import Hidden, gears
from embodiedreamer_gym.standin.plant import (
    add_payload,
    build_plant,
    disturb_links,
    end_effectors,
)

Array = np.ndarray
EFFORT_SCALE_ANGLE = 0.05  # rad; a joint's torque scale is its servo's torque at this error


class StandIn:
    """A robot in another physics engine; the same rng seed gives the same robot and the same logs.

    stiffness, damping, rotor_inertia, viscous_friction: (n,) or one number, per recorded unit. effects: see
    `hidden`. mass_error, gain_error, viscous_error: half-widths of uniform relative errors per link or joint;
    com_error: m. normalised: joint -> URDF values at 0 and 1. furnish: adds objects with contacts, see `build_plant`.
    `true` has the servo values that were drawn.

    Raises: ModelError, EffectError, MissingExtraError.
    """

    def __init__(
        self,
        urdf: str | Path,
        joints: Sequence[str],
        stiffness: Any,
        damping: Any,
        rotor_inertia: Any,
        viscous_friction: Any,
        effects: Mapping[str, Mapping[str, Any]] | None = None,
        mass_error: float = 0.0,
        com_error: float = 0.0,
        gain_error: float = 0.0,
        viscous_error: float = 0.0,
        rng: np.random.Generator | None = None,
        normalised: Mapping[str, tuple[float, float]] | None = None,
        end_effector_links: Sequence[str] | None = None,
        timestep: float = 1e-4,
        furnish: Callable[[Any], None] | None = None,
    ) -> None:
        self.joints, self.timestep = tuple(joints), float(timestep)
        self.rng = rng if rng is not None else np.random.default_rng(0)
        n = len(self.joints)
        strokes = [(normalised or {}).get(name, (0.0, 1.0)) for name in self.joints]
        self._zero = np.array([low for low, _ in strokes], float)
        self._stroke = np.array([high - low for low, high in strokes], float)
        if np.any(self._stroke <= 0):
            raise ModelError("a normalised joint needs a URDF value at 1 that is above its value at 0.")
        scatter = {"stiffness": gain_error, "damping": gain_error, "viscous_friction": viscous_error}
        given = dict(
            stiffness=stiffness,
            damping=damping,
            rotor_inertia=rotor_inertia,
            viscous_friction=viscous_friction,
        )
        self.true = {
            key: np.full(n, np.asarray(value, float)) * (1 + scatter.get(key, 0.0) * self.rng.uniform(-1, 1, n))
            for key, value in given.items()
        }
        self.effort_scale = EFFORT_SCALE_ANGLE * self.true["stiffness"]
        root = read_xml(urdf)
        plain = copy.deepcopy(root)
        disturb_links(root, mass_error, com_error, self.rng)
        self.end_effectors = tips = tuple(end_effector_links or end_effectors(root, self.joints))
        self._hidden = Hidden(effects or {}, self._stroke, len(tips))
        mass, com = self._hidden.get("payload", "mass"), [self._hidden.get("payload", axis) for axis in "xyz"]
        for arm in np.flatnonzero(mass):
            add_payload(root, tips[arm], mass[arm], np.array(com)[:, arm])
        kinds = {j.get("name"): j.get("type") for j in root.iter("joint")}
        self.units = tuple(
            "1" if name in (normalised or {}) else "m" if kinds.get(name) == "prismatic" else "rad"
            for name in self.joints
        )
        plant = build_plant(root, self.joints, self.timestep, gears(self._hidden, self.joints), furnish)
        if len(plant.arm_root) != len(tips):
            raise ModelError(f"the robot has {len(plant.arm_root)} arms but the end effectors {', '.join(tips)}.")
        compensated = self._hidden.get("gravity_compensation", "share").any()
        weigh = build_plant(plain, self.joints, self.timestep).weight() if compensated else None
        self._engine = Engine(plant, self._hidden, self.true, self._zero, self._stroke, self.timestep, weigh)

    def __repr__(self) -> str:
        return f"StandIn({len(self.joints)} joints, timestep {self.timestep:g} s)"

    @property
    def engine(self) -> Engine:
        """The engine, for callers that simulate the arm piece by piece."""
        return self._engine

    @property
    def moving_mass(self) -> float:
        """Mass of all moving links, kg."""
        return self._engine.moving_mass

    def run(self, setpoint: Callable[[Array], Array], duration: float) -> tuple[Array, Array, Array, Array]:
        """True time (T,), position, velocity and actuator torque (T, n) at every step, recorded units.

        Raises: SimulationError when the arm does not come to rest first or the engine diverges.
        """
        return self._engine.run(setpoint, duration)

    def gravity_torque(self, position: Array) -> Array:
        """Torque (T, n) N m that holds the arm still at measured positions (T, n)."""
        return self._engine.gravity_torque(position)

    @renamed_arguments(rate="hz")
    def record(
        self,
        motion: Motion,
        hz: float = 100.0,
        noise: Any = 0.0,
        quantum: Any = 0.0,
        jitter: float = 0.0,
        effort_noise: float = 0.0,
        velocity_noise: float = 0.0,
        command_known: Literal["continuous", "linear", "hold"] = "continuous",
        with_effort: bool = True,
        declare: str = "unknown",
        name: str | None = None,
    ) -> Recording:
        """Play a motion and log it at `hz` samples per second.

        noise, quantum: sd and step of the measured position, recorded units, one number or (n,); jitter: sd
        of the time stamps, s, clipped at 0.45 of a step; effort_noise: share of `effort_scale`; velocity_noise: sd,
        unit/s; command_known: how the controller interpolates the logged commands, or "continuous" for the exact
        motion; declare: the log's `command_hold`.
        """
        instants = np.arange(int(np.floor(motion.duration * hz + 1e-9)) + 1) / hz
        command, n = motion(instants), len(self.joints)
        if command.shape[1] != n:
            raise RecordingError(f"the motion has {command.shape[1]} joints but the stand-in has {n}.")
        setpoint = {
            "continuous": motion,
            "linear": lambda t: np.stack([np.interp(t, instants, c) for c in command.T], axis=1),
            "hold": lambda t: command[np.clip(np.floor(t * hz + 1e-6).astype(int), 0, len(command) - 1)],
        }[command_known]
        time, *signals = self.run(setpoint, instants[-1])
        position, velocity, effort = (_at(instants, time, signal) for signal in signals)
        size = position.shape
        position = (
            position
            + self._hidden.get("encoder_offset", "angle") / self._stroke
            + np.asarray(noise) * self.rng.standard_normal(size)
        )
        step = np.broadcast_to(np.asarray(quantum, float), (n,))
        position = np.where(step > 0, np.round(position / np.where(step > 0, step, 1)) * step, position)
        velocity = velocity + velocity_noise * self.rng.standard_normal(size)
        effort = effort + effort_noise * self.effort_scale * self.rng.standard_normal(size)
        jitter = max(jitter, *self._hidden.get("timestamp_jitter", "seconds"))
        stamps = instants + np.clip(jitter * self.rng.standard_normal(len(instants)), -0.45 / hz, 0.45 / hz)
        return Recording(
            name=name or f"{motion.kind}-1",
            joints=self.joints,
            time=stamps,
            position=position,
            command=command,
            velocity=velocity,
            effort=effort if with_effort else None,
            units=self.units,
            command_hold=declare,
            effort_unit="N m" if with_effort else "unknown",
            kind=motion.kind,
        )


def _at(instants: Array, time: Array, signal: Array) -> Array:
    """Values (T, n) at the instants (T,), linear between the engine's steps."""
    place = np.clip(instants / (time[1] - time[0]), 0, len(time) - 1.000001)
    k = np.floor(place + 1e-9).astype(int)
    share = np.clip(place - k, 0, 1)[:, None]
    return signal[k] + share * (signal[k + 1] - signal[k])
