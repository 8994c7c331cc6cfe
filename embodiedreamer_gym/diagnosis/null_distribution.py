"""What a faultless robot would show: masses and centres of mass that the URDF does not have quite right.

No parameter of a fit absorbs them, so a chi-square table would accuse almost every healthy robot. The residuals of
such a robot are drawn from the linearised model: r = J_m m + J_p p, with p what a calibration would answer to m,
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
LEAST_SPREAD = 0.3  # of a joint's log chi2: a sensor's noise is known no better


@dataclass(frozen=True, eq=False)
class Null:
    """Faultless robots whose masses are off: their held-out chi2 (draws, n) after calibration; rollouts spent.

    sway (m,): standard deviation that the masses give the calibrated parameters, in scaled units.
    """

    chi2: np.ndarray
    rollouts: int
    sway: np.ndarray

    def p_value(self, chi2: np.ndarray) -> float:
        """Share of faultless robots as bad as a robot's chi2 (n,): in the sum over joints, or in their worst joint.

        The smaller of both shares, doubled for having looked twice; never zero (Davison and Hinkley 1997, eq. 4.11).
        The worst joint is the one whose log chi2 stands out most, in its own distance from median to 95 %.
        """
        drawn, seen = np.log(np.maximum(self.chi2, 1.0)), np.log(np.maximum(chi2, 1.0))
        middle, high = np.quantile(drawn, (0.5, 0.95), axis=0)
        spread = np.maximum(high - middle, LEAST_SPREAD)
        total, worst = drawn.sum(axis=1), ((drawn - middle) / spread).max(axis=1)
        pairs = ((total, seen.sum()), (worst, ((seen - middle) / spread).max()))
        shares = [(1 + np.sum(draws >= value)) / (1 + len(draws)) for draws, value in pairs]
        return float(min(1.0, 2 * min(shares)))


def draw_null(
    model: RobotModel, fit: Fit, problem: Problem, test: Sequence[Recording], rng: np.random.Generator
) -> Null:  # fmt: skip
    """Draw faultless robots like a calibrated model and score them on the held-out recordings."""
    heavy = model.with_effect(InertialError)
    hold = problem.hold
    known = Problem(heavy, problem.recordings, ("inertial_error",), hold)
    wrong_train = known.jacobian(known.start)[1]
    unseen = Problem(heavy, test, ("inertial_error",), hold)
    wrong_test = unseen.jacobian(unseen.start)[1]
    calibrated = Problem(model, test, tuple({row.key.group for row in problem.rows}), hold)
    answer_test = calibrated.jacobian(np.clip(fit.x, calibrated.lower, calibrated.upper))[1]
    size = np.array([(MASS / 0.02) if row.key.parameter.endswith("mass") else CENTRE / 0.002 for row in known.rows])
    weight = fit.weight[:, None]
    answer = np.linalg.lstsq(fit.jacobian * weight, -wrong_train * weight, rcond=1e-6)[0]
    left = wrong_test + answer_test @ answer
    draws = rng.standard_normal((DRAWS, len(size))) * size
    chi2 = np.zeros((DRAWS, model.n))
    for j in range(model.n):
        own = left[unseen.joint_of == j]
        if len(own):
            chi2[:, j] = np.sum(draws @ (own.T @ own / len(own)) * draws, axis=1)
    counts = np.maximum(unseen.joint_counts, 1)
    sd = np.sqrt(2.0 / counts + SENSOR**2)
    noise = FIRST_STATE + np.exp(sd * rng.standard_normal(chi2.shape))
    sway = np.sqrt(np.sum((answer * size) ** 2, axis=1))
    return Null(noise + chi2, known.rollouts + unseen.rollouts + calibrated.rollouts, sway)
