"""CMA-ES, the covariance matrix adaptation of the `cma` library, on the scaled parameters."""

from __future__ import annotations

import math

import cma
import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.search_range import FACTOR, SearchRange, cost

BUDGET = 400
FIRST_STEP = 0.2  # of the range; the library recommends a fifth to a third


def cma_es(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback = silent, budget: int = BUDGET,
    factor: float = FACTOR,
) -> np.ndarray:  # fmt: skip
    """Best scaled parameters (m,) after at most `budget` rollouts; each population is simulated at once.

    Raises: CalibrationError for a budget smaller than one population.
    Source: Hansen, The CMA Evolution Strategy: A Tutorial, arXiv 1604.00772.
    """
    box = SearchRange(problem, factor)
    options = {"bounds": [0.0, 1.0], "verbose": -9, "seed": math.nan,  # nan: do not seed numpy's global state
               "randn": lambda *shape: rng.standard_normal(shape)}  # fmt: skip
    strategy = cma.CMAEvolutionStrategy(box.start.tolist(), FIRST_STEP, options)
    size = int(strategy.popsize)
    if budget < size + 1:
        raise CalibrationError(f"CMA-ES needs a budget of at least {size + 1} rollouts here, not {budget}.")
    best, lowest = box.start, float(cost(problem, box.x(box.start))[0])
    for generation in range((budget - 1) // size):
        points = np.array(strategy.ask())
        costs = cost(problem, box.x(points))
        strategy.tell(list(points), costs.tolist())
        if costs.min() < lowest:
            best, lowest = points[int(costs.argmin())], float(costs.min())
        progress("CMA-ES", generation, (budget - 1) // size, lowest_cost=f"{lowest:.4g}")
        if strategy.stop():
            break
    return box.x(best)
