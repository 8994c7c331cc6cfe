"""The parameters of a robot model as one table: value, bounds, unit, interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ParameterRow:
    """One number of the model; `group` is e.g. "stiffness" or "coulomb_friction.torque", `index` its joint or arm."""

    group: str
    joint: str
    index: int
    value: float
    low: float
    high: float
    unit: str
    off: float | None = None
    interval: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """Full name, e.g. "stiffness[joint1]"."""
        return f"{self.group}[{self.joint}]"


@dataclass(frozen=True)
class ParameterTable:
    """Rows of parameters, printed as a table."""

    rows: tuple[ParameterRow, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self):
        return iter(self.rows)

    def __getitem__(self, name: str) -> ParameterRow:
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"no parameter '{name}'; there are {', '.join(r.name for r in self.rows)}")

    def select(self, *groups: str) -> ParameterTable:
        """Only the rows of these groups; an effect's name that is no group's selects all of its groups."""
        wholes = set(groups) - {r.group for r in self.rows}
        return ParameterTable(tuple(r for r in self.rows if r.group in groups or r.group.split(".")[0] in wholes))

    def of_effect(self, name: str) -> ParameterTable:
        """Only the rows of an effect."""
        return ParameterTable(tuple(r for r in self.rows if r.group.startswith(f"{name}.")))

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
