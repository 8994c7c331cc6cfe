"""One step of the servo-driven joints: acceleration under half-step damping, dry friction and speed limits.

PyBullet integrates v += a dt, q += v dt, a leapfrog whose velocity belongs to t - dt/2. Damping is therefore taken
at the mean of the old and the new velocity, (M + R + (d + b) dt/2) a = p e - (d + b) v - h + load - friction,
which at 240 Hz agrees with an engine at 10 kHz. Friction is a stopping impulse, solved over the coupled joints by
projected Gauss-Seidel (Moreau's time stepping), since a joint-by-joint stop flips signs through the coupling.
"""

from __future__ import annotations

import numba as nb
import numpy as np

SWEEPS = 60
SPEED_TOLERANCE = 1e-10  # rad/s


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solve_step(mass, bias, velocity, pull, stiffness, damping, viscous, rotor, load, fixed, fixed_torque,
               budget_forward, budget_backward, slowest, fastest, dt, impulse, acceleration, torque):  # fmt: skip
    """Solve one step for a batch; arrays (B, n), mass (B, n, n).

    pull: p * error, N m; fixed: joints whose torque is fixed_torque instead of the servo's; impulse: friction's
    impulse of the last step on entry (a warm start), of this step on return; acceleration, torque: results, the
    servo's torque at the mean velocity of the step.
    """
    batch, n = velocity.shape
    a = np.empty((n, n))
    low = np.empty((n, n))
    inverse = np.empty((n, n))
    new, slack, soft = np.empty(n), np.empty(n), np.empty(n)
    for b in range(batch):
        constrained = False
        for i in range(n):
            for j in range(n):
                a[i, j] = mass[b, i, j]
            d = 0.0 if fixed[b, i] else damping[b, i]
            a[i, i] += rotor[b, i] + 0.5 * dt * (d + viscous[b, i])
            stiff = 0.0 if fixed[b, i] else stiffness[b, i] * dt * dt
            soft[i] = max(0.0, stiff - a[i, i])  # a mode faster than the step resolves is taken implicitly
            a[i, i] += soft[i]
            drive = fixed_torque[b, i] if fixed[b, i] else pull[b, i] - d * velocity[b, i]
            new[i] = drive - (viscous[b, i] + soft[i] / dt) * velocity[b, i] - bias[b, i] + load[b, i]
            if budget_forward[b, i] > 0.0 or budget_backward[b, i] > 0.0:
                constrained = True
        for i in range(n):  # Cholesky factor
            for j in range(i + 1):
                s = a[i, j]
                for k in range(j):
                    s -= low[i, k] * low[j, k]
                low[i, j] = np.sqrt(max(s, 1e-300)) if i == j else s / low[j, j]
        for i in range(n):
            s = new[i]
            for k in range(i):
                s -= low[i, k] * slack[k]
            slack[i] = s / low[i, i]
        for i in range(n - 1, -1, -1):
            s = slack[i]
            for k in range(i + 1, n):
                s -= low[k, i] * acceleration[b, k]
            acceleration[b, i] = s / low[i, i]
        for i in range(n):
            new[i] = velocity[b, i] + dt * acceleration[b, i]
            if new[i] > fastest[b, i] or new[i] < slowest[b, i] or impulse[b, i] != 0.0:
                constrained = True
        if constrained:
            _invert(low, inverse, slack, n)
            _friction(inverse, new, impulse[b], budget_forward[b], budget_backward[b], slowest[b], fastest[b], dt, n)
            for i in range(n):
                acceleration[b, i] = (new[i] - velocity[b, i]) / dt
        for i in range(n):
            if fixed[b, i]:
                torque[b, i] = fixed_torque[b, i]
            else:
                mean = velocity[b, i] + 0.5 * dt * acceleration[b, i]
                torque[b, i] = pull[b, i] - damping[b, i] * mean - soft[i] * new[i] / dt


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _invert(low, inverse, column, n):
    """Inverse of low low^T, where `low` is a Cholesky factor."""
    for c in range(n):
        for i in range(n):
            s = 1.0 if i == c else 0.0
            for k in range(i):
                s -= low[i, k] * column[k]
            column[i] = s / low[i, i]
        for i in range(n - 1, -1, -1):
            s = column[i]
            for k in range(i + 1, n):
                s -= low[k, i] * inverse[k, c]
            inverse[i, c] = s / low[i, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _friction(inverse, speed, impulse, forward, backward, slowest, fastest, dt, n):
    """Projected Gauss-Seidel on the impulses: sticking, sliding or at a speed limit, each joint in turn."""
    for i in range(n):
        if impulse[i] != 0.0:
            for k in range(n):
                speed[k] -= inverse[k, i] * impulse[i]
    for _ in range(SWEEPS):
        change = 0.0
        for i in range(n):
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
                for k in range(n):
                    speed[k] -= inverse[k, i] * step
                change = max(change, abs(step * own))
        if change < SPEED_TOLERANCE:
            break
