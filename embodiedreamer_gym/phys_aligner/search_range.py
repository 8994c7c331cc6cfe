"""Search range: a box around a problem's start, and the cost of its points."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.problem import Problem

FACTOR = 3.0  # from the start to either end of the box
SMALL = 1e-3  # scaled units; a parameter that is nearer to zero has no size of its own


class SearchRange:
    """Unit coordinates u (m,) in 0..1 of the scaled parameters from start / factor to start * factor.

    The logarithm of a parameter is linear in u. A parameter that starts at zero is searched within one typical size of
    zero. The box is cut at the parameters' bounds.
    Raises: CalibrationError for a factor that is not above one.
    """

    def __init__(self, problem: Problem, factor: float = FACTOR) -> None:
        if not factor > 1.0:
            raise CalibrationError(f"a search range of a factor {factor:g} is empty; give one above 1, say 3.")
        start = problem.start
        logarithm = np.array([row.low > 0 for row in problem.rows])
        self._geometric = ~logarithm & (np.abs(start) > SMALL)
        self._sign = np.where(self._geometric, np.sign(start), 1.0)
        low = np.where(logarithm, start - np.log(factor), start - 1.0)
        high = np.where(logarithm, start + np.log(factor), start + 1.0)
        size = np.abs(start)
        low = np.where(self._geometric, np.where(start > 0, size / factor, -size * factor), low)
        high = np.where(self._geometric, np.where(start > 0, size * factor, -size / factor), high)
        low, high = np.maximum(low, problem.lower), np.minimum(high, problem.upper)
        self._low, self._high = np.sort(np.stack([self._inner(low), self._inner(high)]), axis=0)
        width = np.maximum(self._high - self._low, 1e-12)
        self.start = np.clip((self._inner(start) - self._low) / width, 0.0, 1.0)

    def __repr__(self) -> str:
        return f"SearchRange({len(self.start)} parameters)"

    def _inner(self, x: np.ndarray) -> np.ndarray:
        return np.where(self._geometric, np.log(np.maximum(np.abs(x), 1e-12)), x)

    def x(self, u: np.ndarray) -> np.ndarray:
        """Scaled parameters (..., m) at unit coordinates (..., m)."""
        inner = self._low + (self._high - self._low) * np.clip(u, 0.0, 1.0)
        return np.where(self._geometric, self._sign * np.exp(np.where(self._geometric, inner, 0.0)), inner)


def cost(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Mean over joints of each joint's root mean square error (P,), in its unit, at scaled parameters (P, m)."""
    return (problem.joint_rms(problem.residuals(x)) * problem.sigma).mean(axis=1)
