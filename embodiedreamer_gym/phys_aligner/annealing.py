"""Simulated annealing with SimplerEnv's settings, and with a temperature that fits the cost."""

from __future__ import annotations

import math

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.search_range import FACTOR, SearchRange, cost

STEPS = 400  # as the baseline of EmbodieDreamer, section 4.1; SimplerEnv's own script takes 2000
HOTTEST = 1.5  # SimplerEnv, tools/sysid/sysid.py: t_max=1.5, t_min=0, linear cooling, steps of +-1/2 of the range
COOL = 0.02  # share of the cost at the start
SHORT = 0.15  # share of the range


def annealing(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback = silent, steps: int = STEPS,
    t_max: float = HOTTEST, step: float = 1.0, factor: float = FACTOR,
) -> np.ndarray:  # fmt: skip
    """Best scaled parameters (m,) of an annealing with SimplerEnv's settings.

    A temperature of 1.5 is far above the cost's differences of about 0.01 rad, so nearly every step is accepted, and
    the result is the best point of a random walk.
    Raises: CalibrationError for fewer than two steps.
    Source: SimplerEnv, tools/sysid/sysid.py, and the linear additive cooling of the annealer it calls.
    """
    return anneal(problem, rng, progress, steps, t_max, step, factor)[0]


def annealing_scaled(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback = silent, steps: int = STEPS,
    t_max: float = COOL, step: float = SHORT, factor: float = FACTOR,
) -> np.ndarray:  # fmt: skip
    """Best scaled parameters (m,) of an annealing with shorter steps, and t_max as a share of the cost at the start.

    Raises: CalibrationError for fewer than two steps.
    """
    return anneal(problem, rng, progress, steps, t_max, step, factor, scaled=True)[0]


def anneal(
    problem: Problem, rng: np.random.Generator, progress: ProgressCallback, steps: int, t_max: float,
    step: float, factor: float = FACTOR, scaled: bool = False,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Best scaled parameters (m,) and share of accepted moves; moves are uniform in +-step/2 of the range."""
    if steps < 2:
        raise CalibrationError(f"annealing needs at least 2 steps, not {steps}.")
    box = SearchRange(problem, factor)
    current = best = box.start
    current_cost = lowest = float(cost(problem, box.x(current))[0])
    hottest = t_max * current_cost if scaled else t_max
    accepted = 0
    for k in range(1, steps):
        temperature = hottest * (1 - (k - 1) / steps)
        candidate = np.clip(current + step * (rng.random(len(current)) - 0.5), 0.0, 1.0)
        candidate_cost = float(cost(problem, box.x(candidate))[0])
        if candidate_cost <= current_cost or rng.random() < math.exp((current_cost - candidate_cost) / temperature):
            current, current_cost = candidate, candidate_cost
            accepted += 1
        if candidate_cost < lowest:
            best, lowest = candidate, candidate_cost
        progress("annealing", k, steps, lowest_cost=f"{lowest:.4g}")
    return box.x(best), accepted / (steps - 1)
