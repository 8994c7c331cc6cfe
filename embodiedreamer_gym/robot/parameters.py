"""The parameters of a robot model: their names, and a table of them with bounds, units and intervals."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from embodiedreamer_gym.errors import ModelError

TEXT = re.compile(r"(?:(?P<effect>\w+)\.)?(?P<parameter>\w+)(?:\[(?P<place>.+)\])?", re.DOTALL)
Value = TypeVar("Value")


def unit_at(unit: str, coordinate: str) -> str:
    """A unit of a turning joint's parameter, such as "N m/rad", for a joint whose coordinate is in m or normalised ("1").

    Work per coordinate stays the same: for a sliding joint, N m becomes N, rad becomes m, and kg m^2 becomes kg.
    """
    if coordinate == "rad":
        return unit
    if coordinate == "m":
        unit = unit.replace("N m", "N").replace("kg m^2", "kg").replace("(N)", "N")
    return unit.replace("rad", coordinate)


@dataclass(frozen=True)
class ParameterKey:
    """The name of one parameter, or of a group of them. Text form: "stiffness[joint1]", "payload.mass[tip]".

    parameter: name of the servo's or the effect's parameter;
    effect: name of the effect, "" for the servo's own parameters;
    place: joint or arm that the value belongs to, "" for the group of all of them.
    """

    parameter: str
    effect: str = ""
    place: str = ""

    @staticmethod
    def of(text: str | ParameterKey) -> ParameterKey:
        """Read the text form.

        Raises: ModelError when the text is not of that form.
        """
        if isinstance(text, ParameterKey):
            return text
        match = TEXT.fullmatch(text)
        if match is None:
            raise ModelError(f"'{text}' names no parameter; write it as stiffness[joint1] or payload.mass[tip].")
        return ParameterKey(match["parameter"], match["effect"] or "", match["place"] or "")

    @property
    def group(self) -> ParameterKey:
        """The same parameter at all places."""
        return replace(self, place="")

    def at(self, place: str) -> ParameterKey:
        """Return the same parameter at one joint or arm."""
        return replace(self, place=place)

    def __str__(self) -> str:
        name = f"{self.effect}.{self.parameter}" if self.effect else self.parameter
        return f"{name}[{self.place}]" if self.place else name


def by_key(values: Mapping[str, Value] | Mapping[ParameterKey, Value]) -> dict[ParameterKey, Value]:
    """Return a mapping with keys converted by `ParameterKey.of`."""
    return {ParameterKey.of(key): value for key, value in values.items()}


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of a model.

    key: its name;
    index: number of its joint or arm;
    value, low, high: the value and its bounds, in `unit`;
    off: value at which the effect vanishes, None for the servo's parameters;
    interval: 95 % interval of the last calibration, None if there is none.
    """

    key: ParameterKey
    index: int
    value: float
    low: float
    high: float
    unit: str
    off: float | None = None
    interval: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """Text form of the key, e.g. "stiffness[joint1]"."""
        return str(self.key)


@dataclass(frozen=True)
class ParameterTable:
    """Rows of parameters, printed as a table."""

    rows: tuple[ParameterRow, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[ParameterRow]:
        return iter(self.rows)

    def __getitem__(self, name: str | ParameterKey) -> ParameterRow:
        for row in self.rows:
            if name in (row.key, row.name):
                return row
        raise KeyError(f"no parameter '{name}'; there are {', '.join(r.name for r in self.rows)}")

    def select(self, *groups: str | ParameterKey) -> ParameterTable:
        """Return the rows of these groups; an effect's name that is no group's selects all of its parameters."""
        keys = {ParameterKey.of(group) for group in groups}
        effects = {key.parameter for key in keys - {r.key.group for r in self.rows}}
        return ParameterTable(tuple(r for r in self.rows if r.key.group in keys or r.key.effect in effects))

    def of_effect(self, name: str) -> ParameterTable:
        """Return the rows of an effect."""
        return ParameterTable(tuple(r for r in self.rows if r.key.effect == name))

    @property
    def values(self) -> np.ndarray:
        """Values (m,)."""
        return np.array([row.value for row in self.rows])

    def __str__(self) -> str:
        lines = [f"{'parameter':<42} {'value':>10} {'95 % interval':>23}  {'bounds':>19}  unit"]
        for r in self.rows:
            interval = f"[{r.interval[0]:.4g}, {r.interval[1]:.4g}]" if r.interval else "-"
            lines.append(
                f"{r.name:<42} {r.value:>10.4g} {interval:>23}  {f'{r.low:.3g} .. {r.high:.3g}':>19}  {r.unit}"
            )
        return "\n".join(lines)
