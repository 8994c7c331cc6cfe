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
from embodiedreamer_gym.robot import RobotModel

MASS = 0.02  # relative standard deviation of a link's mass
CENTRE = 0.0025  # m, of each coordinate of its centre of mass
SENSOR = 0.15  # relative sd of the sensor's variance as it is estimated from a log
FIRST_STATE = 0.02  # of a sensor's variance: the first state of a run is measured, not known
DRAWS = 2000
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
    perturbed = model.with_effect(InertialError)
    hold = problem.hold
    train_problem = Problem(perturbed, problem.recordings, ("inertial_error",), hold)
    mass_train = train_problem.jacobian(train_problem.start)[1]
    test_problem = Problem(perturbed, test, ("inertial_error",), hold)
    mass_test = test_problem.jacobian(test_problem.start)[1]
    calibrated = Problem(model, test, tuple({row.key.group for row in problem.rows}), hold)
    response_test = calibrated.jacobian(np.clip(fit.x, calibrated.lower, calibrated.upper))[1]
    size = np.array(
        [(MASS / 0.02) if row.key.parameter.endswith("mass") else CENTRE / 0.002 for row in train_problem.rows]
    )
    weight = fit.weight[:, None]
    response = np.linalg.lstsq(fit.jacobian * weight, -mass_train * weight, rcond=1e-6)[0]
    residual = mass_test + response_test @ response
    draws = rng.standard_normal((DRAWS, len(size))) * size
    chi2 = np.zeros((DRAWS, model.n))
    for j in range(model.n):
        own = residual[test_problem.joint_of == j]
        if len(own):
            chi2[:, j] = np.sum(draws @ (own.T @ own / len(own)) * draws, axis=1)
    counts = np.maximum(test_problem.joint_counts, 1)
    sd = np.sqrt(2.0 / counts + SENSOR**2)
    noise = FIRST_STATE + np.exp(sd * rng.standard_normal(chi2.shape))
    parameter_sd = np.sqrt(np.sum((response * size) ** 2, axis=1))
    return NullDistribution(
        noise + chi2, train_problem.rollouts + test_problem.rollouts + calibrated.rollouts, parameter_sd
    )
