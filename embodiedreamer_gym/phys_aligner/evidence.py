"""Evidence of a fitted model: how probable its recordings are, averaged over its parameters and the URDF's errors."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.phys_aligner.least_squares import Fit
from embodiedreamer_gym.phys_aligner.problem import Problem

SIZES = np.geomspace(0.03, 1.5, 12)  # of the URDF's errors, relative to the standard deviations of the prior
WIDE = 3.0  # scaled units, prior standard deviation of all other parameters


def log_evidence(problem: Problem, fit: Fit) -> float:
    """Natural logarithm of the evidence, up to a constant that depends on the recordings only.

    Laplace's approximation at the fit. The common size of the URDF's errors is the most probable one (type-II maximum
    likelihood; MacKay, Neural Computation 4(3), 1992): a URDF that is wrong only in the direction in which a payload
    acts is less probable than a payload on a correct URDF.
    """
    chi2 = np.maximum(problem.joint_rms(fit.residuals)[0] ** 2, 1.0)
    root = np.sqrt(problem.independent / chi2[problem.joint_of])
    jacobian, residuals = fit.jacobian * root[:, None], fit.residuals * root
    normal, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
    centre = np.where(problem.prior > 0, fit.x, 0.0)
    best = -np.inf
    for size in SIZES:
        precision = np.where(problem.of_urdf, 1.0 / size**2, np.where(problem.prior > 0, 1.0, 1.0 / WIDE**2))
        information = normal + np.diag(precision)
        step = -np.linalg.solve(information, gradient + precision * centre)
        misfit = residuals @ residuals + 2 * gradient @ step + step @ normal @ step
        misfit += np.sum(precision * (centre + step) ** 2)
        volume = np.linalg.slogdet(information)[1] - np.sum(np.log(precision))
        best = max(best, -0.5 * (misfit + volume))
    return float(best - 0.5 * problem.independent * np.sum(np.log((chi2 * problem.sigma**2)[problem.joint_of])))
