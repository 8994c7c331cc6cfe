"""What a drive's limits leave of a torque."""

from __future__ import annotations

import numba as nb
import numpy as np

jit = nb.njit(cache=True, nogil=True, error_model="numpy")


@jit
def within_limits(pull, damping, velocity, limits):
    """The servo's torque, pull - damping * velocity (B, n), as far as the drive's limits leave it at that speed."""
    out = np.empty_like(pull)
    for b in range(pull.shape[0]):
        for i in range(pull.shape[1]):
            top = min(limits[0, b, i], limits[4, b, i] * (1.0 - velocity[b, i] / limits[2, b, i]))
            bottom = min(limits[1, b, i], limits[4, b, i] * (1.0 + velocity[b, i] / limits[3, b, i]))
            out[b, i] = min(max(pull[b, i] - damping[b, i] * velocity[b, i], -bottom), top)
    return out
