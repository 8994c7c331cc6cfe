"""The data of a robot model: its fields, their checks, and values derived from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from embodiedreamer_gym.effects import CATALOGUE, NUISANCES, Effect, Mechanics, Parameter
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.dynamics import RigidBodies
from embodiedreamer_gym.robot.parameters import ParameterKey
from embodiedreamer_gym.robot.transmission import Transmission
from embodiedreamer_gym.robot.tree import KinematicTree

SERVO_GROUPS = ("stiffness", "damping", "rotor_inertia", "viscous_friction")
GRAVITY = np.array([0.0, 0.0, -9.81])
LEAST_GEAR = 0.03  # of the arm's largest rotor inertia and viscous friction: every joint's may reach this
FINGER_FORCE = 10.0  # N, assumed for a sliding joint, whose mass says little about its drive
HOLDS = ("linear", "hold", "unknown")


@dataclass(frozen=True)
class UrdfError:
    """Standard deviations of the errors in a URDF's values for each link.

    mass: relative, of the mass.
    centre: m, of each coordinate of the centre of mass.
    inertia: relative, of the inertia about the centre of mass.
    Raises: ModelError for a number that is not positive, or a relative one above 1.
    """

    mass: float = 0.10
    centre: float = 0.010
    inertia: float = 0.20

    def __post_init__(self) -> None:
        for name, most in (("mass", 1.0), ("centre", 1.0), ("inertia", 1.0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
                raise ModelError(f"urdf_error: {name} must be a number above 0, at most {most:g}, not {value!r}.")

    def scale(self, name: str) -> float:
        """Factor of an effect's parameters whose scale is "urdf_..."; a body's inertia grows with twice its stretch."""
        return {"urdf_mass": self.mass, "urdf_centre": self.centre, "urdf_stretch": self.inertia / 2}[name]


@dataclass(frozen=True, eq=False)
class RobotData:
    """Fields of a robot model, frozen; n is the number of driven joints.

    name: of the model, shown in tables;
    urdf: path of the URDF;
    joints: names of the driven joints, in the order of the logs' columns;
    tree: the URDF's moving bodies;
    stiffness, damping (n,): the servo's law is torque = stiffness (command - position) - damping velocity;
    rotor_inertia (n,): kg m^2 at the joint;
    viscous_friction (n,): N m s/rad;
    effects: physical effects beyond those, each with its values;
    command_hold: what the controller does between two logged commands: "linear", "hold" or "unknown";
    given: the servo groups that the user stated; a calibration estimates the others;
    intervals: text form of a `ParameterKey` -> 95 % interval of the last calibration;
    normalised: joint -> its value in the URDF, m or rad, at 0 and at 1;
    gravity_compensation (n,): share of the URDF's weight that the servo carries by itself, without an error;
    urdf_error: how far the URDF's masses, centres and inertias may be off;
    fixed: groups of parameters and effects that no fit changes, as text ("stiffness", "coulomb_friction");
    transmission: between the motors of the logs and the joints; None if the logs are of the joints;
    end_effectors: links whose pose is compared; () takes the last link of each arm;
    catalogue: effects that `RobotModel.with_effect` finds by name.
    Raises: ModelError for an invalid value.
    """

    name: str
    urdf: Path
    joints: tuple[str, ...]
    tree: KinematicTree = field(repr=False)
    stiffness: np.ndarray = field(repr=False)
    damping: np.ndarray = field(repr=False)
    rotor_inertia: np.ndarray = field(repr=False)
    viscous_friction: np.ndarray = field(repr=False)
    effects: tuple[Effect, ...] = ()
    command_hold: str = "unknown"
    given: frozenset[str] = field(default=frozenset(SERVO_GROUPS), repr=False)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    normalised: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    end_effectors: tuple[str, ...] = field(default=(), repr=False)
    gravity_compensation: np.ndarray = field(default_factory=lambda: np.zeros(1), repr=False)
    urdf_error: UrdfError = UrdfError()
    fixed: frozenset[str] = frozenset()
    transmission: Transmission | None = field(default=None, repr=False)
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: CATALOGUE, repr=False)

    def __post_init__(self) -> None:
        for group in SERVO_GROUPS:
            values = np.array(getattr(self, group), float)
            if values.shape != (len(self.joints),):
                raise ModelError(
                    f"model {self.name}: {group} needs {len(self.joints)} numbers, one per joint, not {values.shape}."
                )
            if not np.all(np.isfinite(values)) or np.any(values < 0):
                raise ModelError(f"model {self.name}: {group} must be finite and not negative.")
            values.setflags(write=False)
            object.__setattr__(self, group, values)
        share = np.array(np.broadcast_to(self.gravity_compensation, len(self.joints)), float)
        if not np.all((share >= 0) & (share <= 2)):
            raise ModelError(f"model {self.name}: gravity_compensation must be a share from 0 to 2.")
        object.__setattr__(self, "gravity_compensation", share)
        if not isinstance(self.command_hold, str) or self.command_hold not in HOLDS:
            raise ModelError(f"model {self.name}: command_hold '{self.command_hold}' is not one of {', '.join(HOLDS)}.")
        if self.transmission is not None and len(self.transmission.motors) != len(self.joints):
            raise ModelError(f"model {self.name}: transmission must have as many motors as there are joints.")
        names = [e.name for e in self.effects]
        if len(set(names)) != len(names):
            raise ModelError(f"model {self.name}: an effect is listed twice ({', '.join(names)}).")
        for effect in self.effects:
            for parameter in effect.parameters:
                self._check_names(effect, parameter)
        for text in self.fixed:
            key = ParameterKey.of(text)
            if key.parameter not in SERVO_GROUPS and not {key.effect, key.parameter} & {*self.catalogue, *NUISANCES}:
                raise ModelError(
                    f"model {self.name}: fixed names '{text}', which is neither a servo parameter nor an effect."
                )

    def _check_names(self, effect: Effect, parameter: Parameter) -> None:
        """Check that an effect names only joints (or arms) of the model, and that its values are within bounds."""
        allowed = self.places(parameter)
        low, high = self.parameter_bounds(parameter)
        for joint, value in effect.values[parameter.name].items():
            if joint not in allowed:
                raise ModelError(
                    f"model {self.name}: effect {effect.name} names '{joint}'; its {parameter.per}s are {', '.join(allowed)}."
                )
            i = allowed.index(joint)
            slack = 1e-9 * (high[i] - low[i])
            if not low[i] - slack <= value <= high[i] + slack:
                raise ModelError(
                    f"model {self.name}: {effect.name}.{parameter.name} of {joint} is {value:g} {parameter.unit}, "
                    f"outside its bounds {low[i]:g} .. {high[i]:g}."
                )

    @property
    def n(self) -> int:
        """Number of driven joints."""
        return len(self.joints)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint: "rad", "m" or "1" (normalised gripper)."""
        return self.tree.units

    @cached_property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms: their end effector's link, else their first joint."""
        names = []
        for arm in range(self.tree.arms):
            first = self.joints[int(np.flatnonzero(self.tree.arm == arm)[0])]
            tips = [t for t, (body, _, _) in self.tree.tips.items() if self.tree.arm[self.tree.coordinate[body]] == arm]
            names.append(tips[0] if tips else first)
        return tuple(names)

    @cached_property
    def bodies(self) -> RigidBodies:
        """The compiled dynamics of this model's tree."""
        return RigidBodies(self.tree)

    @cached_property
    def nominal_mechanics(self) -> Mechanics:
        """Rigid bodies of the URDF, a batch of one."""
        tree = self.tree
        tips = list(tree.tips.values())
        return Mechanics(
            mass=tree.mass[None].copy(),
            first_moment=tree.first_moment[None].copy(),
            inertia=tree.inertia[None].copy(),
            gravity=np.broadcast_to(GRAVITY, (1, tree.arms, 3)).copy(),
            rotor_inertia=self.rotor_inertia[None].copy(),
            tip_body=np.array([t[0] for t in tips], np.int64),
            tip_point=np.array([t[2] for t in tips], float).reshape(-1, 3),
        )

    @cached_property
    def inertia_scale(self) -> np.ndarray:
        """Median diagonal (n,) of the mass matrix over 64 poses, kg m^2 (in the joint's own unit)."""
        return self._scales[0]

    @cached_property
    def torque_scale(self) -> np.ndarray:
        """Typical torque (n,), N m, from the URDF alone.

        It is the largest torque by gravity in 64 poses, plus the torque for 10 rad/s^2.
        """
        return self._scales[1]

    @cached_property
    def _scales(self) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(0)
        low = np.where(np.isfinite(self.tree.lower), self.tree.lower, -np.pi)
        high = np.where(np.isfinite(self.tree.upper), self.tree.upper, np.pi)
        q = low + (high - low) * rng.random((64, self.n))
        matrix, bias = self.bodies.mass_matrix_and_bias(q, np.zeros_like(q), self.nominal_mechanics)
        inertia = np.median(np.diagonal(matrix, axis1=1, axis2=2), axis=0)
        gain = np.array([np.abs(self.tree.gain[self.tree.coordinate == j]).max() for j in range(self.n)])
        sliding = np.array([self.tree.prismatic[self.tree.coordinate == j].any() for j in range(self.n)])
        torque = np.abs(bias).max(0) + inertia * 10.0 / gain
        for arm in range(self.tree.arms):  # the gears of a light wrist are not light in proportion
            same = self.tree.arm == arm
            strongest = torque[same & ~sliding].max(initial=0.0)
            torque[same] = np.maximum(
                torque[same], np.where(sliding, FINGER_FORCE, 0.03 * strongest)[same] * gain[same]
            )
        return inertia, torque

    def parameter_bounds(self, parameter: Parameter) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest value of an effect's parameter, per joint or arm (n,) or (arms,)."""
        factor = self._parameter_scale(parameter)
        return parameter.low * factor, parameter.high * factor

    def parameter_off(self, parameter: Parameter) -> np.ndarray:
        """Value (n,) or (arms,) at which an effect's parameter vanishes."""
        return parameter.off * self._parameter_scale(parameter)

    def places(self, parameter: Parameter) -> tuple[str, ...]:
        """Names of the joints, or of the arms, for which an effect's parameter has values."""
        return self.joints if parameter.per == "joint" else self.arms

    def find_parameter(self, key: ParameterKey) -> tuple[Effect, Parameter]:
        """The effect and the parameter that a key names.

        Raises: ModelError when the model has no such effect, or the effect no such parameter.
        """
        for effect in self.effects:
            for parameter in effect.parameters:
                if (effect.name, parameter.name) == (key.effect, key.parameter):
                    return effect, parameter
        raise ModelError(f"model {self.name} has no parameter '{key.group}'.")

    def group_values(self, key: ParameterKey) -> np.ndarray:
        """Copy of the current values (n,) or (arms,) of a group of parameters; "off" where an effect has no value.

        Raises: ModelError when the model has no such group.
        """
        if not key.effect and key.parameter in SERVO_GROUPS:
            return getattr(self, key.parameter).copy()
        effect, parameter = self.find_parameter(key)
        values, places = self.parameter_off(parameter).copy(), self.places(parameter)
        for place, value in effect.values[parameter.name].items():
            values[places.index(place)] = value
        return values

    def _parameter_scale(self, parameter: Parameter) -> np.ndarray:
        if parameter.per == "arm" or not parameter.scale:
            return np.ones(len(self.places(parameter)))
        if parameter.scale.startswith("urdf"):
            return np.full(self.n, self.urdf_error.scale(parameter.scale))
        return self.torque_scale if parameter.scale == "torque" else 1.0 / self.torque_scale

    def servo_bounds(self, group: str) -> tuple[np.ndarray, np.ndarray]:
        """Search bounds (n,) of a servo group: wide, and around the current value too."""
        inertia = self.inertia_scale + self.rotor_inertia
        typical = {
            "stiffness": inertia * (2 * np.pi * 5.0) ** 2,  # 5 Hz
            "damping": inertia * 2 * (2 * np.pi * 5.0),
            "rotor_inertia": self.inertia_scale,
            "viscous_friction": inertia * (2 * np.pi * 5.0),
        }[group]
        spread = {"stiffness": 100.0, "damping": 100.0, "rotor_inertia": 30.0, "viscous_friction": 30.0}[group]
        value = getattr(self, group)
        if group in ("rotor_inertia", "viscous_friction"):  # gears of a light wrist are not light in proportion
            typical = np.maximum(typical, LEAST_GEAR * self._of_arm(typical))
        low = np.minimum(typical / spread, value / 10) if group in ("stiffness", "damping") else np.zeros(self.n)
        return low, np.maximum(typical * spread, value * 10)

    def _of_arm(self, values: np.ndarray) -> np.ndarray:
        """Largest value (n,) among the revolute joints of each joint's arm; for a sliding joint, its own value."""
        largest = values.copy()
        for arm in range(self.tree.arms):
            same = (self.tree.arm == arm) & (np.array(self.units) == "rad")
            largest[same] = values[same].max(initial=0.0)
        return largest

    def first_guess(self) -> dict[str, np.ndarray]:
        """Servo values (n,) from the inertia alone: 5 Hz, damping ratio 0.7, rotor inertia half of the load's."""
        rotor = 0.5 * self.inertia_scale
        omega = 2 * np.pi * 5.0
        return {
            "stiffness": (self.inertia_scale + rotor) * omega**2,
            "damping": (self.inertia_scale + rotor) * 1.4 * omega,
            "rotor_inertia": rotor,
            "viscous_friction": np.zeros(self.n),
        }
