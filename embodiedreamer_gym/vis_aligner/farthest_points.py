"""Farthest-point sampling: selects rows that differ most from each other."""

from __future__ import annotations

import numpy as np


def spread(places: np.ndarray, count: int, weight: np.ndarray, labels: np.ndarray | None = None) -> np.ndarray:
    """Rows (at most count), in order, of places (T, M, 3) far from each other; weight (T,): higher is preferred."""
    flat = places.reshape(len(places), -1)
    chosen = [int(np.argmax(weight))]
    away = np.linalg.norm(flat - flat[chosen[0]], axis=1)
    while len(chosen) < min(count, len(flat)):
        best = int(np.argmax(away * weight))
        if away[best] <= 0.0:
            break
        chosen.append(best)
        away = np.minimum(away, np.linalg.norm(flat - flat[best], axis=1))
    rows = np.sort(chosen)
    return rows if labels is None else labels[rows]
