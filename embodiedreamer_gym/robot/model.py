"""RobotModel: a URDF, a servo, rotor inertia, viscous friction and a tuple of effects; one readable JSON file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import CATALOGUE, Effect, Mechanics, find_effect
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import files
from embodiedreamer_gym.robot.dynamics import RigidBodies
from embodiedreamer_gym.robot.parameters import ParameterRow, ParameterTable
from embodiedreamer_gym.robot.tree import KinematicTree, build_tree

SERVO_GROUPS = ("stiffness", "damping", "rotor_inertia", "viscous_friction")
SERVO_UNITS = {
    "stiffness": "N m/rad",
    "damping": "N m s/rad",
    "rotor_inertia": "kg m^2",
    "viscous_friction": "N m s/rad",
}
GRAVITY = np.array([0.0, 0.0, -9.81])
FINGER_FORCE = 10.0  # N, of a sliding joint too light to show what drives it
ROBOT_KEYS = ("urdf", "joints", "end_effectors", "normalised")
HOLDS = ("linear", "hold", "unknown")


@dataclass(frozen=True, eq=False)
class RobotModel:
    """What the simulator knows of a robot; frozen, `with_...` returns a new one.

    stiffness (p), damping (d) (n,): the servo's law tau = p (command - position) - d velocity; rotor_inertia,
    viscous_friction (n,); effects: links of the signal chain; command_hold: what the controller does between two
    logged commands; given: the servo groups that the user stated (the others are to be estimated);
    intervals: parameter name -> 95 % interval of the last calibration.
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
        if not isinstance(self.command_hold, str) or self.command_hold not in HOLDS:
            raise ModelError(f"model {self.name}: command_hold '{self.command_hold}' is none of {', '.join(HOLDS)}.")
        names = [e.name for e in self.effects]
        if len(set(names)) != len(names):
            raise ModelError(f"model {self.name}: an effect is listed twice ({', '.join(names)}).")
        for effect in self.effects:
            for parameter in effect.parameters:
                self._check_names(effect, parameter)

    def _check_names(self, effect: Effect, parameter) -> None:
        """Every joint (or arm) an effect names is one of the model's, and its value lies inside the bounds."""
        allowed = self.joints if parameter.per == "joint" else self.arms
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

    # ---- names -------------------------------------------------------------------------------------------------

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

    # ---- changes -----------------------------------------------------------------------------------------------

    def with_(self, **changes: Any) -> RobotModel:
        """Return a copy with these fields changed."""
        return replace(self, **changes)

    def with_effect(self, effect: str | Effect | type[Effect], joints: tuple[str, ...] | None = None) -> RobotModel:
        """Return a copy with one more effect; a name or class starts off (vanishing) on the joints given, else on all.

        Raises: EffectError for an unknown name, ModelError when the model has that effect already.
        """
        if not isinstance(effect, Effect):
            kind = find_effect(effect, self.catalogue) if isinstance(effect, str) else effect
            values = {}
            for p in kind.parameters:
                off = self.parameter_off(p)
                names = self.joints if p.per == "joint" else self.arms
                keep = [i for i, name in enumerate(names) if joints is None or p.per == "arm" or name in joints]
                values[p.name] = {names[i]: float(off[i]) for i in keep}
            effect = kind(**values)
        return replace(self, effects=(*self.effects, effect), catalogue={**self.catalogue, effect.name: type(effect)})

    def without_effect(self, name: str) -> RobotModel:
        """Return a copy without the effect of that name.

        Raises: ModelError when the model has no such effect.
        """
        if name not in [e.name for e in self.effects]:
            raise ModelError(f"model {self.name} has no effect '{name}'.")
        intervals = {k: v for k, v in self.intervals.items() if not k.startswith(f"{name}.")}
        return replace(self, effects=tuple(e for e in self.effects if e.name != name), intervals=intervals)

    # ---- parameters --------------------------------------------------------------------------------------------

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
        """A torque (n,) N m typical of the joint, from the URDF alone: gravity's largest of 64 poses + 10 rad/s^2."""
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
        for arm in range(self.tree.arms):  # a light wrist's gears are not lighter than that of its arm in proportion
            same = self.tree.arm == arm
            strongest = torque[same & ~sliding].max(initial=0.0)
            torque[same] = np.maximum(
                torque[same], np.where(sliding, FINGER_FORCE, 0.03 * strongest)[same] * gain[same]
            )
        return inertia, torque

    def parameter_bounds(self, parameter) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest value of an effect's parameter, per joint or arm (n,) or (arms,)."""
        factor = self._parameter_scale(parameter)
        return parameter.low * factor, parameter.high * factor

    def parameter_off(self, parameter) -> np.ndarray:
        """Value (n,) or (arms,) at which an effect's parameter vanishes."""
        return parameter.off * self._parameter_scale(parameter)

    def _parameter_scale(self, parameter) -> np.ndarray:
        if parameter.per == "arm" or not parameter.scale:
            return np.ones(self.n if parameter.per == "joint" else len(self.arms))
        return self.torque_scale if parameter.scale == "torque" else 1.0 / self.torque_scale

    def parameters(self) -> ParameterTable:
        """Every number of the model as a table: servo, rotor inertia, viscous friction, then the effects'."""
        rows = []
        for group in SERVO_GROUPS:
            low, high = self.servo_bounds(group)
            for i, joint in enumerate(self.joints):
                name = f"{group}[{joint}]"
                unit = (
                    SERVO_UNITS[group] if self.units[i] == "rad" else SERVO_UNITS[group].replace("rad", self.units[i])
                )
                rows.append(
                    ParameterRow(group, joint, i, float(getattr(self, group)[i]), low[i], high[i], unit,
                                 interval=self.intervals.get(name))
                )  # fmt: skip
        for effect in self.effects:
            for p in effect.parameters:
                names = self.joints if p.per == "joint" else self.arms
                (low, high), off = self.parameter_bounds(p), self.parameter_off(p)
                for joint, value in effect.values[p.name].items():
                    i = names.index(joint)
                    row = ParameterRow(f"{effect.name}.{p.name}", joint, i, value, low[i], high[i], p.unit,
                                       float(off[i]))  # fmt: skip
                    rows.append(replace(row, interval=self.intervals.get(row.name)))
        return ParameterTable(tuple(rows))

    def servo_bounds(self, group: str) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (n,) inside which a servo group is looked for; wide, and around the present value too."""
        inertia = self.inertia_scale + self.rotor_inertia
        typical = {
            "stiffness": inertia * (2 * np.pi * 5.0) ** 2,  # 5 Hz
            "damping": inertia * 2 * (2 * np.pi * 5.0),
            "rotor_inertia": self.inertia_scale,
            "viscous_friction": inertia * (2 * np.pi * 5.0),
        }[group]
        spread = {"stiffness": 100.0, "damping": 100.0, "rotor_inertia": 30.0, "viscous_friction": 30.0}[group]
        value = getattr(self, group)
        low = np.minimum(typical / spread, value / 10) if group in ("stiffness", "damping") else np.zeros(self.n)
        return low, np.maximum(typical * spread, value * 10)

    def with_values(self, values: Mapping[str, Mapping[str, float]], intervals=None) -> RobotModel:
        """Return a copy with numbers changed: group ("stiffness", "payload.mass") -> joint -> value."""
        servo = {g: getattr(self, g).copy() for g in SERVO_GROUPS if g in values}
        for group, array in servo.items():
            for joint, value in values[group].items():
                array[self.joints.index(joint)] = value
        effects = []
        for effect in self.effects:
            changed = {
                p.name: {**effect.values[p.name], **values.get(f"{effect.name}.{p.name}", {})}
                for p in effect.parameters
            }
            effects.append(type(effect)(**changed))
        extra = {} if intervals is None else {"intervals": dict(intervals)}
        return replace(self, effects=tuple(effects), **servo, **extra)

    # ---- files -------------------------------------------------------------------------------------------------

    @staticmethod
    def load(source: str | Path, catalogue: Mapping[str, type[Effect]] = CATALOGUE) -> RobotModel:
        """Read a model from a JSON file, or a built-in robot by name; servo groups left out get a first guess.

        Raises: ModelError (EffectError for an unknown effect) in one sentence.
        """
        path = files.find_model(source)
        data = files.read_json(path)
        robot, servo = files.table(data, "robot", ROBOT_KEYS, path), files.table(data, "servo", SERVO_GROUPS[:2], path)
        urdf = files.urdf_path(robot["urdf"], path)
        joints = files.names(robot.get("joints"), "robot.joints", path)
        if not joints:
            raise ModelError(f"model {path} names no joint; list the driven ones in robot.joints.")
        tips = files.names(robot.get("end_effectors", []), "robot.end_effectors", path)
        normalised = {
            joint: files.ends(ends, f"robot.normalised of {joint}", path)
            for joint, ends in files.table(robot, "normalised", joints, path).items()
        }
        tree = build_tree(urdf, joints, normalised, tips)
        n = len(joints)
        stated = {"stiffness": servo.get("stiffness"), "damping": servo.get("damping")}
        stated |= {"rotor_inertia": data.get("rotor_inertia"), "viscous_friction": data.get("viscous_friction")}
        given = {k: np.array(files.numbers(v, n, k, path)) for k, v in stated.items() if v is not None}
        blank = dict.fromkeys(SERVO_GROUPS, np.zeros(n))
        model = RobotModel(
            name=data.get("name", path.stem), urdf=urdf, joints=joints, tree=tree, **{**blank, **given},
            command_hold=data.get("command_hold", "unknown"), given=frozenset(given), catalogue=catalogue,
            intervals={k: files.pair(v, f"interval of {k}", path) for k, v in files.table(data, "intervals", None, path).items()},
            normalised=normalised, end_effectors=tips,
        )  # fmt: skip
        model = model.with_(**{g: v for g, v in model.first_guess().items() if g not in given})
        if not isinstance(data.get("effects", []), list):
            raise ModelError(f"model {path}: effects must be a list of objects, each with a name.")
        effects = tuple(_read_effect(entry, model, path) for entry in data.get("effects", []))
        return model.with_(effects=effects)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON (beside, then renamed); the URDF's path is stored relative to it."""
        path = Path(path)
        robot: dict[str, Any] = {"urdf": files.urdf_text(self.urdf, path), "joints": list(self.joints)}
        if self.end_effectors:
            robot["end_effectors"] = list(self.end_effectors)
        if self.normalised:
            robot["normalised"] = {k: list(v) for k, v in self.normalised.items()}
        data = {
            "name": self.name,
            "robot": robot,
            "servo": {"stiffness": self.stiffness.tolist(), "damping": self.damping.tolist()},
            "rotor_inertia": self.rotor_inertia.tolist(),
            "viscous_friction": self.viscous_friction.tolist(),
            "command_hold": self.command_hold,
            "effects": [{"name": e.name, **e.values} for e in self.effects],
            "intervals": {k: list(v) for k, v in self.intervals.items()},
        }
        files.write_json(data, path)

    def first_guess(self) -> dict[str, np.ndarray]:
        """Servo values (n,) from the inertia alone: 5 Hz, damping ratio 0.7, rotor as heavy as half the load."""
        rotor = 0.5 * self.inertia_scale
        omega = 2 * np.pi * 5.0
        return {
            "stiffness": (self.inertia_scale + rotor) * omega**2,
            "damping": (self.inertia_scale + rotor) * 1.4 * omega,
            "rotor_inertia": rotor,
            "viscous_friction": np.zeros(self.n),
        }


def _read_effect(entry: Any, model: RobotModel, path: Path) -> Effect:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ModelError(f"model {path}: each effect must be an object with a name.")
    kind = find_effect(entry["name"], model.catalogue)
    per = {p.name: model.joints if p.per == "joint" else model.arms for p in kind.parameters}
    return kind(**{
        key: files.by_joint(value, per.get(key, ()), f"effect {kind.name}, {key}", path)
        for key, value in entry.items() if key != "name"
    })  # fmt: skip
