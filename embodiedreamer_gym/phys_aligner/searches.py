"""The searches by name that `calibrate` offers besides least squares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from embodiedreamer_gym.phys_aligner.annealing import annealing, annealing_scaled
from embodiedreamer_gym.phys_aligner.cma_es import cma_es
from embodiedreamer_gym.phys_aligner.surrogate import surrogate
from embodiedreamer_gym.phys_aligner.trajectory_surrogate import trajectory_surrogate

Search = Callable[..., np.ndarray]  # (problem, rng, progress=None, **options) -> scaled parameters (m,)

SEARCHES: dict[str, Any] = {
    "surrogate": surrogate,
    "surrogate-trajectory": trajectory_surrogate,
    "annealing": annealing,
    "annealing-scaled": annealing_scaled,
    "cma-es": cma_es,
}
