"""Null distribution: held-out errors of faultless robots, whose masses and centres of mass differ a little from the URDF.

No fitted parameter absorbs that, so a chi-square table would reject almost every faultless robot. The residuals of such
a robot are drawn from the linearised model: r = J_m m + J_p p, with p the change of a calibration in response to m,
beside the sensor's noise, whose size is only estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel

MASS = 0.02  # relative standard deviation of a link's mass
CENTRE = 0.0025  # m, of each coordinate of its centre of mass
SENSOR = 0.15  # relative sd of the sensor's variance as it is estimated from a log
COMMON = 0.15  # the like, shared by all joints: of efforts, whose noise is that of a smoothed motion's acceleration
FIRST_STATE = 0.02  # of a sensor's variance: the first state of a run is measured, not known
DRAWS = 2000
GROUPS = tuple(ParameterKey(name, InertialError.name) for name in ("mass", "x", "y", "z"))
LEAST_SPREAD = 0.3  # of a joint's log chi2: the accuracy to which a sensor's noise is known


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Faultless robots with wrong masses.

    chi2: (draws, n), held out, after calibration.
    rollouts: how many were spent.
    parameter_sd: (m,), standard deviation that the masses give the calibrated parameters, in scaled units.
    """

    chi2: np.ndarray
    rollouts: int
    parameter_sd: np.ndarray

    def p_value(self, chi2: np.ndarray) -> float:
        """Share of faultless robots as bad as a robot's chi2 (n,): in the sum over joints, or in their worst joint.

        The smaller of both shares, doubled for the two tests; never zero (Davison and Hinkley 1997, eq. 4.11).
        The worst joint is the one whose log chi2 stands out most, in its own distance from median to 95 %.
        """
        drawn, observed = np.log(np.maximum(self.chi2, 1.0)), np.log(np.maximum(chi2, 1.0))
        middle, high = np.quantile(drawn, (0.5, 0.95), axis=0)
        spread = np.maximum(high - middle, LEAST_SPREAD)
        total, worst = drawn.sum(axis=1), ((drawn - middle) / spread).max(axis=1)
        pairs = ((total, observed.sum()), (worst, ((observed - middle) / spread).max()))
        shares = [(1 + np.sum(draws >= value)) / (1 + len(draws)) for draws, value in pairs]
        return float(min(1.0, 2 * min(shares)))


def draw_null(
    model: RobotModel, fit: Fit, problem: Problem, test: Sequence[Recording], rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """Draw faultless robots like a calibrated model and score them on the held-out recordings."""
    if model.has_effect(InertialError):
        return _estimated_masses(model, fit, problem, test, rng)
    perturbed = model.with_effect(InertialError)
    hold = problem.hold
    train_problem = Problem(perturbed, problem.recordings, GROUPS, hold)
    mass_train = train_problem.jacobian(train_problem.start)[1]
    test_problem = Problem(perturbed, test, GROUPS, hold)
    mass_test = test_problem.jacobian(test_problem.start)[1]
    calibrated = Problem(model, test, tuple({row.key.group for row in problem.rows}), hold)
    response_test = calibrated.jacobian(np.clip(fit.x, calibrated.lower, calibrated.upper))[1]
    sd = {"mass": MASS / model.urdf_error.mass}  # in scaled units
    size = np.array([sd.get(row.key.parameter, CENTRE / model.urdf_error.centre) for row in train_problem.rows])
    weight = fit.weight[:, None]
    response = np.linalg.lstsq(fit.jacobian * weight, -mass_train * weight, rcond=1e-6)[0]
    residual = mass_test + response_test @ response
    draws = rng.standard_normal((DRAWS, len(size))) * size
    chi2 = _left(draws, residual, test_problem)
    parameter_sd = np.sqrt(np.sum((response * size) ** 2, axis=1))
    rollouts = train_problem.rollouts + test_problem.rollouts + calibrated.rollouts
    return _null(chi2, test_problem, rollouts, parameter_sd, rng)


def _estimated_masses(
    model: RobotModel, fit: Fit, problem: Problem, test: Sequence[Recording], rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """Robots whose masses the fit has estimated: what is left is how well the training motion determines all parameters."""
    judged = Problem(model, test, tuple({row.key.group for row in problem.rows}), problem.hold)
    response = judged.jacobian(np.clip(fit.x, judged.lower, judged.upper))[1]
    information = problem.independent * fit.jacobian.T @ fit.jacobian + np.diag(problem.prior)
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    root = vectors / np.sqrt(np.maximum(values, 1e-8)) / size[:, None]
    draws = rng.standard_normal((DRAWS, len(size))) @ root.T
    return _null(_left(draws, response, judged), judged, judged.rollouts, np.zeros(len(size)), rng)


def _left(draws: np.ndarray, response: np.ndarray, problem: Problem) -> np.ndarray:
    """Mean square residual (draws, n) of each joint that changes (draws, m) of parameters leave."""
    chi2 = np.zeros((len(draws), problem.model.n))
    for j in range(problem.model.n):
        own = response[problem.joint_of == j]
        if len(own):
            chi2[:, j] = np.sum(draws @ (own.T @ own / len(own)) * draws, axis=1)
    return chi2


def _null(
    chi2: np.ndarray, problem: Problem, rollouts: int, parameter_sd: np.ndarray, rng: np.random.Generator
) -> NullDistribution:  # fmt: skip
    """The distribution of what masses leave (draws, n), with the sensors' noise added."""
    sd = np.sqrt(2.0 / np.maximum(problem.joint_counts, 1) + SENSOR**2)
    common = COMMON * rng.standard_normal((len(chi2), 1)) if problem.signals.by_effort else 0.0
    noise = FIRST_STATE + np.exp(sd * rng.standard_normal(chi2.shape) + common)
    return NullDistribution(noise + chi2, rollouts, parameter_sd)
