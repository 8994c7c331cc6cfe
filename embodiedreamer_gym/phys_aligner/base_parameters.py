"""Base parameters: the combinations of masses and inertias that determine the torques of a motion.

A torque is linear in each body's mass, first moment and inertia, but many of these act only in combination with those
of other bodies. Source: Gautier, Journal of Robotic Systems 8(4), 1991 (by a QR decomposition of the regressor).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner.intervals import NORMAL_95, Spread
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording, smooth_derivatives
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation.drive_setup import changed_mechanics, parameter_values

NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "rotor")
UNITS = ("kg", "kg m", "kg m", "kg m", *["kg m^2"] * 7)
ROTOR = ParameterKey("rotor_inertia")
SAMPLES = 400  # largest number of samples of the motion for the regressor
DEPENDENT = 1e-6  # relative residual below which a column is a combination of the columns before it
STEP = 1e-3  # change of a scaled parameter, for derivatives
LEARNT = 0.5  # sd relative to the prior's below which the motion determines a combination


@dataclass(frozen=True)
class BaseParameter:
    """One combination of the bodies' masses and inertias.

    name: its first term, and the number of further terms;
    terms: inertial parameter -> factor, e.g. {"Izz[joint2]": 1.0, "m[joint3]": 0.09}, of mass, first moment and inertia
    in each body's frame, and of the rotor's inertia;
    urdf: its value in the URDF, in `unit`; None if it contains a rotor inertia that the model does not know;
    value: the estimate;
    sd: standard deviation of the estimate;
    prior_sd: standard deviation that the assumed errors of the URDF give it.
    """

    name: str
    terms: dict[str, float]
    unit: str
    urdf: float | None
    value: float
    sd: float
    prior_sd: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        return self.value - NORMAL_95 * self.sd, self.value + NORMAL_95 * self.sd

    @property
    def determined(self) -> bool:
        """Whether the motion makes the estimate clearly more certain than the prior."""
        return self.sd < LEARNT * self.prior_sd

    def as_dict(self) -> dict:
        """The same as JSON."""
        return {"name": self.name, "terms": self.terms, "unit": self.unit, "urdf": self.urdf, "value": self.value,
                "interval": list(self.interval), "determined": self.determined}  # fmt: skip


def base_parameters(problem: Problem, x: np.ndarray, uncertainty: Spread) -> tuple[BaseParameter, ...]:
    """Base parameters of a fit at scaled parameters x (m,) that estimates the URDF's errors; empty for any other fit.

    Combinations that contain only rotor inertias are left out, because these are parameters of the model.
    """
    if not problem.of_urdf.any():
        return ()
    names = [f"{name}[{joint}]" for joint in problem.model.joints for name in NAMES]
    terms = combinations(_regressor(problem.model, problem.recordings))
    of_rotor = np.array([row.key.group == ROTOR for row in problem.rows])
    moved = np.flatnonzero(problem.of_urdf | of_rotor)
    points = np.repeat(x[None], len(moved) + 1, axis=0)
    points[np.arange(len(moved)) + 1, moved] += STEP
    values = _standard_parameters(problem, points) @ terms.T
    slopes = (values[1:] - values[0]).T / STEP  # (base parameters, moved)
    covariance = uncertainty.covariance[np.ix_(moved, moved)]
    unseen = np.isnan(np.diag(covariance))  # on a bound, or without any influence on the residuals
    covariance[unseen], covariance[:, unseen] = 0.0, 0.0
    covariance[unseen, unseen] = problem.prior[moved][unseen]
    urdf = _standard_parameters(problem, np.where(problem.of_urdf, 0.0, problem.start)[None]) @ terms.T
    result = []
    for k, row in enumerate(terms):
        used = np.flatnonzero(row).tolist()
        if all(j % len(NAMES) == NAMES.index("rotor") for j in used):
            continue
        first, others = int(np.flatnonzero(row == 1.0)[0]), len(used) - 1
        name = names[first] + (f" + {others} more" if others else "")
        unknown = slopes[k][of_rotor[moved]].any()
        prior_sd = np.inf if unknown else float(np.linalg.norm(slopes[k] * problem.prior[moved]))
        sd = float(np.sqrt(max(slopes[k] @ covariance @ slopes[k], 0.0)))
        result.append(BaseParameter(name, {names[j]: float(row[j]) for j in used}, UNITS[first % len(NAMES)],
                                    None if unknown else float(urdf[0, k]), float(values[0, k]), sd, prior_sd))  # fmt: skip
    return tuple(result)


def base_parameter_table(parameters: Sequence[BaseParameter]) -> str:
    """The base parameters that the motion determines, as text, and the number of those that it does not determine."""
    lines = ["base parameters: masses and inertias, in the combinations that this motion determines",
             f"{'base parameter':<28} {'URDF':>10} {'estimate':>10} {'95 % interval':>23}  unit"]  # fmt: skip
    for p in (p for p in parameters if p.determined):
        interval = "[{:.4g}, {:.4g}]".format(*p.interval)
        urdf = "-" if p.urdf is None else f"{p.urdf:.4g}"
        lines.append(f"{p.name:<28} {urdf:>10} {p.value:>10.4g} {interval:>23}  {p.unit}")
    left = sum(not p.determined for p in parameters)
    return "\n".join([*lines, f"{left} others are not determined by this motion"] if left else lines)


def combinations(regressor: np.ndarray) -> np.ndarray:
    """Combinations (b, p) of parameters that determine all products of a regressor (N, p) with them.

    Columns are taken in order. A column that the columns before it express is added to them, so that what depends on a
    body further out is assigned to the body that carries it.
    """
    size = np.linalg.norm(regressor, axis=0)
    seen = np.flatnonzero(size > DEPENDENT * size.max(initial=0.0))
    columns = np.asarray(qr(regressor[:, seen] / size[seen], mode="r")[0])  # same products of columns in fewer rows
    own: list[int] = []
    for j in range(len(seen)):
        left = columns[:, j] - columns[:, own] @ np.linalg.lstsq(columns[:, own], columns[:, j], rcond=None)[0]
        if np.linalg.norm(left) > DEPENDENT:
            own.append(j)
    factors = np.linalg.lstsq(columns[:, own], columns, rcond=None)[0] * size[seen] / size[seen[own]][:, None]
    factors[:, own] = np.eye(len(own))
    rows = np.zeros((len(own), regressor.shape[1]))
    rows[:, seen] = np.where(np.abs(factors) > DEPENDENT, factors, 0.0)
    return rows


def _regressor(model: RobotModel, recordings: Sequence[Recording]) -> np.ndarray:
    """Torques (samples * n, n * len(NAMES)) that each inertial parameter alone needs for the recorded motion."""
    motions = [smooth_derivatives(r) for r in recordings]
    state = [np.concatenate([getattr(m, name) for m in motions]) for name in ("position", "velocity", "acceleration")]
    q, v, a = (x[:: -(-len(x) // SAMPLES)] for x in state)
    n, size, nominal = model.n, len(NAMES), model.nominal_mechanics
    unit = np.zeros((n * size, nominal.mass.shape[1], size))
    unit[np.arange(n * size), np.arange(n * size) // size, np.arange(n * size) % size] = 1.0
    each = np.ascontiguousarray(unit[..., : NAMES.index("rotor")]), nominal.gravity  # as in `RigidBodies.pack`
    moves = [np.repeat(x, n * size, axis=0) for x in (q, v, a)]  # sample b: parameter b mod n * size
    torque = model.bodies.inverse_dynamics(moves[0], moves[1], moves[2], each)[0].reshape(len(q), n * size, n)
    for j in range(n):
        torque[:, j * size + NAMES.index("rotor"), j] = a[:, j]
    return np.swapaxes(torque, 1, 2).reshape(-1, n * size)


def _standard_parameters(problem: Problem, points: np.ndarray) -> np.ndarray:
    """Inertial parameters (P, n * len(NAMES)) of scaled parameters (P, m)."""
    model, sets = problem.model, problem.sets(points)
    rotor = sets.get(ROTOR, np.tile(model.rotor_inertia, (len(points), 1)))
    errors = [(e, parameter_values(e, model, sets, len(points))) for e in model.effects if isinstance(e, InertialError)]
    bodies = model.bodies.pack(changed_mechanics(model, rotor, errors))[0][:, : model.n]
    return np.concatenate([bodies, rotor[..., None]], axis=-1).reshape(len(points), -1)
