"""Linear algebra of one arm's joints, compiled: Cholesky factors, and dry friction by projected Gauss-Seidel."""

from __future__ import annotations

import numba as nb
import numpy as np

from embodiedreamer_gym.robot.dynamics import UNWRAPPED

SWEEPS = 60
SPEED_TOLERANCE = 1e-8  # rad/s

inner = nb.njit(nogil=True, error_model="numpy", **UNWRAPPED)


@inner
def factor(mass, diagonal, low, first, end):
    """Cholesky factor of one block of the mass matrix with this diagonal."""
    for i in range(first, end):
        for j in range(first, i + 1):
            s = diagonal[i] if i == j else mass[i, j]
            for k in range(first, j):
                s -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(max(s, 1e-300)) if i == j else s / low[j, j]


@inner
def substitute(low, right, out, work, first, end):
    """Solve low low^T out = right on one block."""
    for i in range(first, end):
        s = right[i]
        for k in range(first, i):
            s -= low[i, k] * work[k]
        work[i] = s / low[i, i]
    for i in range(end - 1, first - 1, -1):
        s = work[i]
        for k in range(i + 1, end):
            s -= low[k, i] * out[k]
        out[i] = s / low[i, i]


@inner
def invert(low, inverse, first, end):
    """Inverse of low low^T on one block; all columns are processed together to use vector instructions."""
    for i in range(first, end):
        for c in range(first, end):
            inverse[i, c] = 1.0 if i == c else 0.0
        for k in range(first, i):
            for c in range(first, end):
                inverse[i, c] -= low[i, k] * inverse[k, c]
        for c in range(first, end):
            inverse[i, c] /= low[i, i]
    for i in range(end - 1, first - 1, -1):
        for k in range(i + 1, end):
            for c in range(first, end):
                inverse[i, c] -= low[k, i] * inverse[k, c]
        for c in range(first, end):
            inverse[i, c] /= low[i, i]


@inner
def stop(inverse, speed, impulse, forward, backward, slowest, fastest, dt, first, end):
    """Projected Gauss-Seidel on the impulses: sticking, sliding or at an end stop, each joint in turn."""
    for i in range(first, end):
        if impulse[i] != 0.0:
            for k in range(first, end):
                speed[k] -= inverse[k, i] * impulse[i]
    for _ in range(SWEEPS):
        change = 0.0
        for i in range(first, end):
            own = inverse[i, i]
            free = speed[i] + own * impulse[i]
            wanted = min(max(free / own, -dt * backward[i]), dt * forward[i])
            left = free - own * wanted
            if left > fastest[i]:
                wanted = (free - fastest[i]) / own
            elif left < slowest[i]:
                wanted = (free - slowest[i]) / own
            step = wanted - impulse[i]
            if step != 0.0:
                impulse[i] = wanted
                for k in range(first, end):
                    speed[k] -= inverse[k, i] * step
                change = max(change, abs(step * own))
        if change < SPEED_TOLERANCE:
            break
