"""Null distribution: held-out errors of faultless robots with masses and centres of mass slightly off the URDF's.

No fitted parameter absorbs these errors of the URDF, so a chi-square table would reject almost every faultless robot.
Viscous friction is wrong too: a servo's damping compensates for it, but not if a drive is at its limit. The residuals
of such a robot are drawn from the linearised model: r = J_m m + J_p p, with p the response of a calibration to m, plus
the noise of the sensors, whose size is only estimated. The derivatives are slopes over changes as large as those of
such robots: a law that jumps, such as backlash, has no derivative, and a slope over a much shorter step would be far
too steep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import STEP, Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.recordings.noise import SMALLEST_SIGMA
from embodiedreamer_gym.robot import ParameterKey, RobotModel

MASS = 0.02  # relative standard deviation of a link's mass
CENTRE = 0.0025  # m, of each coordinate of its centre of mass
SENSOR = 0.15  # least relative sd of the estimate of a sensor's variance
COMMON = 0.15  # the same, shared by all joints, for efforts: their noise is that of a smoothed motion's acceleration
FIRST_STATE = 0.02  # share of a sensor's variance, added because the first state of a run is measured and not exact
DRAWS = 2000
GROUPS = tuple(ParameterKey(name, InertialError.name) for name in ("mass", "x", "y", "z"))
VISCOUS_FRICTION = ParameterKey("viscous_friction")
ANSWER = 0.02  # step, in scaled units, of the derivatives by which a calibration responds to wrong masses
VISCOUS = 0.5  # sd of a joint's viscous friction, relative to its value or to a small default
TRAVEL = 20.0  # travel, in units of sensor noise, above which a joint counts as moving
LEAST_SPREAD = 0.3  # least spread of a joint's log chi2: the accuracy to which a sensor's noise is known


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Faultless robots with wrong masses, after calibration.

    chi2, trained_chi2: (draws, n), on held-out motion and on the fitted motion; the same robot in each row.
    moves: (n,), whether the fitted motion moves a joint far beyond its noise.
    rollouts: number of rollouts that were needed.
    """

    chi2: np.ndarray
    trained_chi2: np.ndarray
    moves: np.ndarray
    rollouts: int

    def p_value(self, chi2: np.ndarray, trained_chi2: np.ndarray) -> float:
        """Share of faultless robots that are as bad as a robot with this chi2 (n,) on held-out and on fitted motion.

        Three tests: the sum over joints on held-out motion, the worst joint on held-out motion, and the worst joint on
        the fitted motion. The result is the smallest share times three; it is never zero (Davison and Hinkley 1997, eq.
        4.11). The worst joint is the one with the highest log chi2 above the median, in units of its distance from
        median to 95 %.
        """
        total, worst = _total_and_worst(self.chi2, chi2)
        tests = [total, worst]
        if self.moves.any():
            tests.append(_total_and_worst(self.trained_chi2[:, self.moves], trained_chi2[self.moves])[1])
        shares = [(1 + np.sum(draws >= value)) / (1 + len(draws)) for draws, value in tests]
        return float(min(1.0, len(shares) * min(shares)))

    def excess(self, chi2: np.ndarray, trained_chi2: np.ndarray) -> float:
        """Worst chi2 (n,) of a joint on either motion, relative to the 95 % quantile of faultless robots.

        The chi2 of each joint is divided by its own 95 % quantile. A result of one is the 95 % quantile of the worst
        joint.
        """
        most, trained_most = np.quantile(self.chi2, 0.95, axis=0), np.quantile(self.trained_chi2, 0.95, axis=0)
        drawn = np.hstack([self.chi2 / most, (self.trained_chi2 / trained_most)[:, self.moves]])
        worst = max((chi2 / most).max(), (trained_chi2 / trained_most)[self.moves].max(initial=0.0))
        return float(worst / np.quantile(drawn.max(axis=1), 0.95))


def _total_and_worst(draws: np.ndarray, chi2: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Sum over joints and worst joint of the log chi2, for draws (draws, n) and for one robot (n,)."""
    drawn, observed = np.log(np.maximum(draws, 1.0)), np.log(np.maximum(chi2, 1.0))
    middle, high = np.quantile(drawn, (0.5, 0.95), axis=0)
    spread = np.maximum(high - middle, LEAST_SPREAD)
    return [(drawn.sum(axis=1), float(observed.sum())),
            (((drawn - middle) / spread).max(axis=1), float(((observed - middle) / spread).max()))]  # fmt: skip


def draw_null(
    model: RobotModel, fit: Fit, problem: Problem, test: Sequence[Recording], rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """Draw faultless robots like a calibrated model, and compute their chi2 on held-out and on fitted recordings."""
    if model.has_effect(InertialError):
        return _estimated_masses(model, fit, problem, test, rng)
    perturbed = model.with_effect(InertialError)
    hold, fitted = problem.hold, tuple(dict.fromkeys(row.key.group for row in problem.rows))
    groups = GROUPS if VISCOUS_FRICTION in fitted else (*GROUPS, VISCOUS_FRICTION)
    train_problem, test_problem = (Problem(perturbed, r, groups, hold) for r in (problem.recordings, test))
    sd = {"mass": MASS / model.urdf_error.mass, VISCOUS_FRICTION.parameter: VISCOUS}  # in scaled units
    size = np.array([sd.get(row.key.parameter, CENTRE / model.urdf_error.centre) for row in train_problem.rows])
    mass_train, mass_test = (p.jacobian(p.start, np.maximum(size, STEP))[1] for p in (train_problem, test_problem))
    calibrated, spent = Problem(model, test, fitted, hold), problem.rollouts
    response_test = calibrated.jacobian(np.clip(fit.x, calibrated.lower, calibrated.upper), ANSWER)[1]
    response_train = problem.jacobian(fit.x, ANSWER)[1]
    weight = fit.weight[:, None]
    response = np.linalg.lstsq(response_train * weight, -mass_train * weight, rcond=1e-6)[0]
    draws = rng.standard_normal((DRAWS, len(size))) * size
    parts = [(draws, mass_test + response_test @ response, test_problem),
             (draws, mass_train + response_train @ response, train_problem)]  # fmt: skip
    rollouts = train_problem.rollouts + test_problem.rollouts + calibrated.rollouts + problem.rollouts - spent
    return _null(parts, rollouts, rng)


def _estimated_masses(
    model: RobotModel, fit: Fit, problem: Problem, test: Sequence[Recording], rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """Null distribution if the fit estimates the masses: errors come from the uncertainty of all parameters."""
    judged = Problem(model, test, tuple({row.key.group for row in problem.rows}), problem.hold)
    response = judged.jacobian(np.clip(fit.x, judged.lower, judged.upper))[1]
    information = problem.independent * fit.jacobian.T @ fit.jacobian + np.diag(problem.prior)
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    root = vectors / np.sqrt(np.maximum(values, 1e-8)) / size[:, None]
    draws = rng.standard_normal((DRAWS, len(size))) @ root.T
    parts = [(draws, response, judged), (draws[:, :0], fit.jacobian[:, :0], problem)]
    return _null(parts, judged.rollouts, rng)


def _left(draws: np.ndarray, response: np.ndarray, problem: Problem) -> np.ndarray:
    """Mean square residual (draws, n) of each joint that changes (draws, m) of the parameters cause."""
    chi2 = np.zeros((len(draws), problem.model.n))
    for j in range(problem.model.n):
        own = response[problem.joint_of == j]
        if len(own):
            chi2[:, j] = np.sum(draws @ (own.T @ own / len(own)) * draws, axis=1)
    return chi2


def _null(
    parts: Sequence[tuple[np.ndarray, np.ndarray, Problem]], rollouts: int, rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """Distribution of the chi2 that wrong parameters cause, with sensor noise added.

    parts: first of held-out, then of fitted motion: draws (draws, k), their effect (N, k) on the residuals, and the
    problem.
    """
    shape = (DRAWS, parts[0][2].model.n)
    sensor = sensor_scatter([r for _, _, p in parts for r in p.recordings]) * rng.standard_normal(shape)
    if parts[0][2].signals.by_effort:
        sensor += COMMON * rng.standard_normal((DRAWS, 1))
    chi2 = []
    for draws, response, problem in parts:
        few = np.sqrt(2.0 / np.maximum(problem.joint_counts, 1)) * rng.standard_normal(shape)
        chi2.append(FIRST_STATE + np.exp(sensor + few) + _left(draws, response, problem))
    return NullDistribution(chi2[0], chi2[1], moving_joints(parts[1][2]), rollouts)


def sensor_scatter(recordings: Sequence[Recording]) -> np.ndarray:
    """Relative sd (n,) of the estimate of a sensor's variance, the same on all motion: that of its mean over logs.

    If a coarse encoder rests most of the time, some recordings show its noise and others do not.
    """
    squares = np.array([r.sigma**2 for r in recordings])
    shown = squares > SMALLEST_SIGMA**2
    count = np.maximum(shown.sum(axis=0), 1)
    mean = np.sum(squares * shown, axis=0) / count
    spread = np.sqrt(np.sum((squares - mean) ** 2 * shown, axis=0) / np.maximum(count - 1, 1) / count)
    return np.maximum(SENSOR, spread / np.maximum(mean, 1e-300))


def moving_joints(problem: Problem) -> np.ndarray:
    """Whether (n,) the recordings move a joint far beyond its noise."""
    travel = np.max([np.ptp(r.position, axis=0) for r in problem.recordings], axis=0)
    return travel > TRAVEL * np.sqrt(np.mean([r.sigma**2 for r in problem.recordings], axis=0))
