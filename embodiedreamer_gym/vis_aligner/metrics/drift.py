"""Drift: how a measure changes from chunk to chunk, as each chunk starts from the last frame of the previous one."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import VisionError


def drift_curve(values: np.ndarray, chunk: int, weights: np.ndarray | None = None) -> np.ndarray:
    """Mean of a measure (T,) or (T, c) in each chunk of `chunk` frames: (chunks,) or (chunks, c).

    weights (T,): for a weighted mean; frames whose value is nan are left out, and a chunk without other frames is nan.
    The last chunk may be shorter. Raises: VisionError when chunk is not above 0, or lengths differ.
    """
    values = np.asarray(values, float)
    weights = np.ones(len(values)) if weights is None else np.asarray(weights, float)
    if chunk < 1 or weights.shape != values.shape[:1] or not len(values):
        raise VisionError(
            f"{len(values)} values, {len(weights)} weights and chunks of {chunk} were given; as many weights as values "
            "and at least one frame in a chunk are expected."
        )
    weights = np.broadcast_to(weights.reshape(-1, *[1] * (values.ndim - 1)), values.shape)
    weights = np.where(np.isnan(values), 0.0, weights)
    starts = np.arange(0, len(values), chunk)
    total = np.add.reduceat(np.nan_to_num(values) * weights, starts, axis=0)
    count = np.add.reduceat(weights, starts, axis=0)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
