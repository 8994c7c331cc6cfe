"""The function that a calibration minimises: residuals of free runs, over the free parameters of a model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.recordings.rounded_noise import mean_rounding_error, rest_numbers
from embodiedreamer_gym.robot import ParameterKey, ParameterRow, RobotModel
from embodiedreamer_gym.simulation import TIME_STEP
from embodiedreamer_gym.simulation.rollout import check_names

CORRELATED = 0.05  # s over which residuals are strongly correlated
STEP = 1e-3  # of finite differences, in scaled units
SLIGHT = 0.05  # torque of slight viscous friction at 1 rad/s, as a share of the joint's typical torque


def free_rows(
    model: RobotModel, groups: Sequence[str | ParameterKey] | None = None, by_effort: bool = False
) -> tuple[ParameterRow, ...]:
    """Parameters that a calibration fits: stiffness, damping, rotor inertia if unknown, and those of all effects.

    Viscous friction acts like damping and is left out, because positions alone cannot distinguish the two. If efforts
    are compared instead (by_effort), it replaces the servo's gains.
    """
    table = model.parameters()
    if groups is not None:
        return table.select(*groups).rows if groups else ()
    servo = {"viscous_friction"} if by_effort else {"stiffness", "damping"}
    if "rotor_inertia" not in model.given:
        servo.add("rotor_inertia")
    free = [row for row in table if row.key.effect or row.key.parameter in servo]
    fixed = set(table.select(*model.fixed).rows) if model.fixed else set()
    return tuple(row for row in free if row not in fixed)


class Problem:
    """Residuals of free runs as a function of scaled parameters x (m,).

    A parameter with a positive lower bound is scaled by its logarithm, any other by a typical size, so that a step of
    one is a large step in each. Residuals are (measured - simulated) / sigma over the usable samples, see `Signals`.
    dt: time step of the plant, s, if positions are compared.
    rollouts: number of parameter sets simulated over all recordings; independent: share of the samples that counts as
    independent; prior (m,): precision of the prior, in scaled units: 1 for parameters of effects that declare one, else
    0; centre (m,): centre of the prior; of_urdf (m,): whether a parameter is an error of the URDF; logarithmic (m,):
    whether a parameter is scaled by its logarithm.
    """

    def __init__(
        self, model: RobotModel, recordings: Sequence[Recording], groups: Sequence[str | ParameterKey] | None = None,
        hold: str | None = None, dt: float = TIME_STEP,
    ) -> None:  # fmt: skip
        if not recordings:
            raise CalibrationError("no recording is left to fit; give at least one.")
        for recording in recordings:
            check_names(model, recording)
        self.signals = Signals(model, recordings)
        self.model, self.recordings, self.hold, self.dt = model, self.signals.recordings, hold, dt
        self.rows = free_rows(model, groups, self.signals.by_effort)
        if not self.rows and groups:
            raise CalibrationError(f"model {model.name} has no free parameter in {groups}.")
        for row in self.rows:
            slack = 1e-9 * (row.high - row.low)
            if not row.low - slack <= row.value <= row.high + slack:
                raise CalibrationError(
                    f"{row.name} starts at {row.value:g}, outside its bounds {row.low:g} .. {row.high:g}."
                )
        self.logarithmic = np.array([row.low > 0 for row in self.rows])
        self._size = np.array(
            [1.0 if log else _typical(model, row) for row, log in zip(self.rows, self.logarithmic, strict=True)]
        )
        self.lower = self.scale(np.array([row.low for row in self.rows]))
        self.upper = self.scale(np.array([row.high for row in self.rows]))
        self.start = np.clip(self.scale(np.array([row.value for row in self.rows])), self.lower, self.upper)
        self.prior = np.array(
            [bool(row.key.effect) and model.find_parameter(row.key)[1].prior for row in self.rows], float
        )
        self.centre = np.zeros(len(self.rows))
        self.of_urdf = np.array([row.key.effect == InertialError.name for row in self.rows], bool)
        self._inertial: np.ndarray | None = None
        self.sigma, usable = self.signals.sigma, self.signals.usable
        self.rollouts = 0
        self.joint_of = np.concatenate([np.nonzero(u)[1] for u in usable])
        self.seconds = sum(r.duration for r in recordings)
        self.joint_counts = np.bincount(self.joint_of, minlength=model.n)
        joints = np.count_nonzero(self.joint_counts)
        self.independent = max(self.seconds / CORRELATED, 1.0) * joints / max(len(self.joint_of), 1)
        self.run_of = np.concatenate([np.full(int(u.sum()), i) for i, u in enumerate(usable)])
        if len(self.joint_of) < len(self.rows) + 1:
            raise CalibrationError(
                "too few usable samples are left to fit; the recordings contain only contact or clipped parts."
            )
        self.arm_of_row = np.array([self._arm(row) for row in self.rows])

    def _arm(self, row: ParameterRow) -> int:
        names, place = self.model.arms, row.key.place
        if place in names and place not in self.model.joints:
            return names.index(place)
        return int(self.model.tree.arm[row.index])

    # ---- scaling -----------------------------------------------------------------------------------------------

    def scale(self, values: np.ndarray) -> np.ndarray:
        """Scaled parameters of values (..., m)."""
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values / self._size)

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values of scaled parameters (..., m)."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, x, 0.0)), x * self._size)

    def times(self, x: np.ndarray, factor: float, rows: np.ndarray) -> np.ndarray:
        """Scaled parameters x (m,) with the values of rows (m,) bool multiplied by a factor, inside their bounds."""
        scaled = np.where(self.logarithmic, x + np.log(factor), x * factor)
        return np.clip(np.where(rows, scaled, x), self.lower, self.upper)

    def sets(self, x: np.ndarray) -> dict[ParameterKey, np.ndarray]:
        """Parameter sets (P, joints or arms) by group, for the simulation, from scaled parameters (P, m)."""
        values = self.values(np.atleast_2d(x))
        groups = dict.fromkeys(row.key.group for row in self.rows)
        sets = {group: np.repeat(self.model.group_values(group)[None], len(values), axis=0) for group in groups}
        for column, row in enumerate(self.rows):
            sets[row.key.group][:, row.index] = values[:, column]
        return sets

    @cached_property
    def rounding(self) -> np.ndarray:
        """Rms (recordings, n), in units of noise, of the mean rounding error at one position; 0 for efforts."""
        if self.signals.by_effort:
            return np.zeros((len(self.recordings), self.model.n))
        return np.stack([mean_rounding_error(r.noise, r.quantum) for r in self.recordings]) / self.sigma

    @cached_property
    def rest_of(self) -> np.ndarray:
        """Number (N,) of the rest to which each sample belongs.

        Neighbouring samples of a joint belong to one rest if their readings are at most one encoder step apart.
        """
        rests = [rest_numbers(r.position, r.quantum) for r in self.recordings]
        return np.concatenate([rest[usable] for rest, usable in zip(rests, self.signals.usable, strict=True)])

    def model_at(self, x: np.ndarray, intervals=None) -> RobotModel:
        """The model with scaled parameters x (m,)."""
        changed: dict[ParameterKey, dict[str, float]] = {}
        for row, value in zip(self.rows, self.values(x), strict=True):
            changed.setdefault(row.key.group, {})[row.key.place] = float(np.clip(value, row.low, row.high))
        return self.model.with_values(changed, intervals)

    # ---- residuals ---------------------------------------------------------------------------------------------

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Residuals (P, N) of scaled parameters (P, m), in units of sensor noise."""
        x = np.clip(np.atleast_2d(x), self.lower, self.upper)
        self.rollouts += len(x)
        return self.signals.residuals(self.model, self.sets(x), self.hold, self.dt)

    def prior_cost(self, x: np.ndarray) -> float:
        """Cost of the distance of scaled parameters (m,) from their prior's centre, on the scale of the fit's cost."""
        return float(np.sum(self.prior * (x - self.centre) ** 2) / (self.independent * len(self.joint_of)))

    def joint_rms(self, residuals: np.ndarray) -> np.ndarray:
        """Root mean square (P, n) of residuals (P, N), in units of sensor noise."""
        return np.sqrt(np.stack([self.joint_mean(row**2) for row in np.atleast_2d(residuals)]))

    def joint_mean(self, samples: np.ndarray) -> np.ndarray:
        """Mean (n,) of samples (N,) by joint, zero for a joint without samples."""
        return np.bincount(self.joint_of, samples, minlength=self.model.n) / np.maximum(self.joint_counts, 1)

    def jacobian(
        self, x: np.ndarray, step: float | np.ndarray = STEP, anew: bool = False, only: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Residuals (N,) and their derivatives (N, m) by one-sided differences, away from the nearer bound.

        Parameters of different arms share a rollout, because the arms do not act on each other. The derivatives with
        respect to the URDF's errors, which are many and nearly constant, are those of the first call, unless `anew` is
        set. only (m,) bool: columns that are needed; the others may be zero. step: of the differences, in scaled units,
        or (m,) for each parameter.
        """
        step = np.broadcast_to(step, x.shape) * np.where(x + step <= self.upper, 1.0, -1.0)
        inertial = self.of_urdf
        if anew:
            self._inertial = None
        wanted = ~inertial if self._inertial is not None else np.ones(len(x), bool)
        colours = self._colours(np.flatnonzero(wanted if only is None else wanted & (only | inertial)))
        points = np.repeat(x[None], len(colours) + 1, axis=0)
        for p, members in enumerate(colours):
            points[p + 1, members] += step[members]
        r = self.residuals(points)
        arm_of_sample = self.model.tree.arm[self.joint_of]
        jacobian = np.zeros((r.shape[1], len(x)))
        for p, members in enumerate(colours):
            change = r[p + 1] - r[0]
            for m in members:
                own = arm_of_sample == self.arm_of_row[m]
                jacobian[own, m] = change[own] / step[m]
        if self._inertial is None:
            self._inertial = jacobian[:, inertial]
        jacobian[:, inertial] = self._inertial
        return r[0], jacobian

    def _colours(self, rows: np.ndarray) -> list[list[int]]:
        """Groups of these parameters (rows), each with one parameter per arm."""
        columns = [rows[self.arm_of_row[rows] == a].tolist() for a in range(self.model.tree.arms)]
        longest = max(len(c) for c in columns)
        return [[c[i] for c in columns if i < len(c)] for i in range(longest)]


def _typical(model: RobotModel, row: ParameterRow) -> float:
    """Typical size of a parameter that may be zero or have either sign."""
    if not row.key.effect:
        if row.key.parameter == "viscous_friction":
            return max(row.value, SLIGHT * float(model.torque_scale[row.index]))
        rotor = row.key.parameter == "rotor_inertia"
        return float(model.inertia_scale[row.index]) if rotor else max(row.value, 1e-3)
    _, parameter = model.find_parameter(row.key)
    if row.key.effect == EffortSensor.name and parameter.per == "joint":
        scale = model.group_values(ParameterKey("scale", EffortSensor.name))[row.index]
        return max(abs(scale), 1e-9) * (1.0 if parameter.name == "scale" else float(model.torque_scale[row.index]))
    span = row.high - row.low
    return span * parameter.typical / (parameter.high - parameter.low)
