"""RobotModel: a URDF, a servo, rotor inertia, viscous friction and a tuple of effects; one readable JSON file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from embodiedreamer_gym.effects import CATALOGUE, NUISANCES, Effect, find_effect
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording, Recordings
from embodiedreamer_gym.robot import model_file
from embodiedreamer_gym.robot.data import SERVO_GROUPS, RobotData
from embodiedreamer_gym.robot.parameters import ParameterKey, ParameterRow, ParameterTable, by_key, unit_at

SERVO_UNITS = {
    "stiffness": "N m/rad",
    "damping": "N m s/rad",
    "rotor_inertia": "kg m^2",
    "viscous_friction": "N m s/rad",
}
ANGLES = ("phase",)  # parameters in rad that are not coordinates of a joint


class RobotModel(RobotData):
    """Model of a robot: URDF, servos and effects; frozen, `with_...` returns a new one. For fields see `RobotData`."""

    @staticmethod
    def load(source: str | Path, catalogue: Mapping[str, type[Effect]] = CATALOGUE) -> RobotModel:
        """Read a model from a JSON file, or a built-in robot by name; servo groups left out get a first guess.

        Raises: ModelError (EffectError for an unknown effect) in one sentence.
        """
        return model_file.read_model(source, catalogue, RobotModel)

    @staticmethod
    def of_urdf(urdf: str | Path, joints: Sequence[str]) -> RobotModel:
        """A model from a URDF alone; joints: names of the joints in the logs, in the order of the columns.

        Raises: ModelError in one sentence.
        """
        path = Path(urdf)
        if not os.path.isfile(path):
            raise ModelError(f"URDF {path} does not exist.")
        data = {"robot": {"urdf": path.name, "joints": list(joints)}}
        return model_file.model_of(data, path, CATALOGUE, RobotModel)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON, atomically; the URDF's path is stored relative to the file.

        Raises: ModelError when the folder does not exist or cannot be written.
        """
        model_file.write_model(self, Path(path))

    def with_(self, **changes: Any) -> RobotModel:
        """Return a copy with these fields changed."""
        return replace(self, **changes)

    def with_effect(self, effect: str | Effect | type[Effect], joints: tuple[str, ...] | None = None) -> RobotModel:
        """Return a copy with one more effect.

        effect: given by name or class, it starts with the values at which it vanishes.
        joints: of such an effect, None for all.
        Raises: EffectError for an unknown name, ModelError when the model has that effect already.
        """
        if not isinstance(effect, Effect):
            kind = find_effect(effect, self.catalogue) if isinstance(effect, str) else effect
            values = {}
            for p in kind.parameters:
                off = zip(self.places(p), self.parameter_off(p), strict=True)
                keep = joints if joints is not None and p.per == "joint" else self.places(p)
                values[p.name] = {place: float(value) for place, value in off if place in keep}
            effect = kind(**values)
        catalogue = self.catalogue if effect.name in NUISANCES else {**self.catalogue, effect.name: type(effect)}
        return replace(self, effects=(*self.effects, effect), catalogue=catalogue)

    def has_effect(self, kind: type[Effect]) -> bool:
        """Whether the model has an effect of this class's name."""
        return any(effect.name == kind.name for effect in self.effects)

    def without_effect(self, name: str) -> RobotModel:
        """Return a copy without the effect of that name, and without its intervals.

        Raises: ModelError when the model has no such effect.
        """
        if name not in [e.name for e in self.effects]:
            raise ModelError(f"model {self.name} has no effect '{name}'.")
        intervals = {text: ends for text, ends in self.intervals.items() if ParameterKey.of(text).effect != name}
        return replace(self, effects=tuple(e for e in self.effects if e.name != name), intervals=intervals)

    def with_fixed(self, *names: str) -> RobotModel:
        """Return a copy in which fits do not change the parameters of these names.

        names: servo parameters, effects, "gains" (stiffness and damping), "urdf" (the errors of its masses) or a family
        of effects, such as "friction" (with viscous friction).
        Raises: ModelError for any other name.
        """
        groups = {"gains": {"stiffness", "damping"}, "urdf": {InertialError.name}, "friction": {"viscous_friction"}}
        for effect in self.effects:
            if effect.family:
                groups.setdefault(effect.family, set()).add(effect.name)
        return replace(self, fixed=self.fixed.union(*(groups.get(name, {name}) for name in names)))

    def from_motors(self, recordings: Iterable[Recording]) -> Recordings:
        """Convert recordings of the motors to recordings of the joints by the transmission; unchanged without one."""
        if self.transmission is None:
            return Recordings(recordings)
        return Recordings(
            self.transmission.to_joints(one.only(self.transmission.motors), self.joints) for one in recordings
        )

    def parameters(self) -> ParameterTable:
        """All parameters of the model as a table: servo, rotor inertia, viscous friction, then the effects'."""
        return ParameterTable((*self._servo_rows(), *self._effect_rows()))

    def _servo_rows(self) -> Iterator[ParameterRow]:
        for group in SERVO_GROUPS:
            low, high = self.servo_bounds(group)
            for i, joint in enumerate(self.joints):
                key, unit = ParameterKey(group, place=joint), unit_at(SERVO_UNITS[group], self.units[i])
                value, interval = float(getattr(self, group)[i]), self.intervals.get(str(key))
                yield ParameterRow(key, i, value, low[i], high[i], unit, interval=interval)

    def _effect_rows(self) -> Iterator[ParameterRow]:
        for effect in self.effects:
            for p in effect.parameters:
                (low, high), off = self.parameter_bounds(p), self.parameter_off(p)
                for place, value in effect.values[p.name].items():
                    i, key = self.places(p).index(place), ParameterKey(p.name, effect.name, place)
                    interval = self.intervals.get(str(key))
                    unit = unit_at(p.unit, self.units[i]) if p.per == "joint" and p.name not in ANGLES else p.unit
                    yield ParameterRow(key, i, value, low[i], high[i], unit, float(off[i]), interval)

    def with_values(
        self,
        values: Mapping[str, Mapping[str, float]] | Mapping[ParameterKey, Mapping[str, float]],
        intervals: Mapping[str, tuple[float, float]] | None = None,
    ) -> RobotModel:
        """Return a copy with values changed: group ("stiffness", "payload.mass") -> joint or arm -> value."""
        changes, servo = by_key(values), {}
        for group in SERVO_GROUPS:
            if ParameterKey(group) in changes:
                servo[group] = getattr(self, group).copy()
                for joint, value in changes[ParameterKey(group)].items():
                    servo[group][self.joints.index(joint)] = value
        effects = tuple(
            type(e)(**{name: {**old, **changes.get(ParameterKey(name, e.name), {})} for name, old in e.values.items()})
            for e in self.effects
        )
        extra = {} if intervals is None else {"intervals": dict(intervals)}
        return replace(self, effects=effects, **servo, **extra)
