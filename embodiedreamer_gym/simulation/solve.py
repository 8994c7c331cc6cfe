"""One step of the servo-driven joints: acceleration under half-step damping, drive limits and dry friction.

PyBullet integrates v += a dt, q += v dt, a leapfrog whose velocity belongs to t - dt/2. Damping is therefore taken
at the mean of the old and the new velocity, (M + R + (d + b) dt/2) a = p e - (d + b) v - h + load - friction,
which at 240 Hz agrees with an engine at 10 kHz. Friction is a stopping impulse, solved over the coupled joints by
projected Gauss-Seidel (Moreau's time stepping), since a joint-by-joint stop flips signs through the coupling.
"""

from __future__ import annotations

import numba as nb
import numpy as np

SWEEPS = 60
SPEED_TOLERANCE = 1e-8  # rad/s
RINGING = 3.0  # damping at the mean speed turns a velocity by (1 - x) / (1 + x) per step, x = dt slope / 2 inertia
PASSES = 4  # over the set of joints whose drive is at a limit
FREE, FIXED, TOP, FAST, BOTTOM, BACK = 0, 1, 2, 3, 4, 5

jit = nb.njit(cache=True, nogil=True, error_model="numpy")


@jit
def solve_step(mass, bias, velocity, pull, stiffness, damping, viscous, rotor, load, fixed, fixed_torque, limits,
               budget_forward, budget_backward, slowest, fastest, blocks, dt, impulse, acceleration, torque):  # fmt: skip
    """Solve one step for a batch; arrays (B, n), mass (B, n, n).

    pull: p * error, N m; fixed: joints whose torque is fixed_torque instead of the servo's; limits (5, B, n): the
    drive's highest torque forward and backward, N m, the speeds at which it fades to nothing, rad/s, and its torque
    at rest on that line, N m; blocks:
    first joint of each independent arm, then n; impulse: friction's of the last step on entry (a warm start), of
    this step on return; acceleration, torque: results, the drive's torque at the mean velocity of the step.
    """
    batch, n = velocity.shape
    low, inverse = np.empty((n, n)), np.empty((n, n))
    diagonal, right, new, work = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    give, slope, soft, late = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    state = np.empty(n, np.int64)
    for b in range(batch):
        for k in range(len(blocks) - 1):
            first, end = blocks[k], blocks[k + 1]
            for i in range(first, end):
                state[i] = FIXED if fixed[b, i] else FREE
            for _ in range(PASSES):
                constrained = False
                for i in range(first, end):
                    base = mass[b, i, i] + rotor[b, i] + 0.5 * dt * viscous[b, i]
                    _drive(state[i], i, b, pull, damping, fixed_torque, limits, give, slope)
                    late[i] = max(0.0, 0.5 * dt * slope[i] - RINGING * base)  # beyond it: a later speed
                    diagonal[i] = base + 0.5 * dt * slope[i] + late[i]
                    stiff = stiffness[b, i] * dt * dt if state[i] == FREE else 0.0
                    soft[i] = max(0.0, stiff - diagonal[i])  # a mode faster than the step resolves: implicit
                    diagonal[i] += soft[i]
                    v = velocity[b, i]
                    right[i] = give[i] - (slope[i] + viscous[b, i] + soft[i] / dt) * v - bias[b, i] + load[b, i]
                _factor(mass[b], diagonal, low, first, end)
                _substitute(low, right, new, work, first, end)
                for i in range(first, end):
                    new[i] = velocity[b, i] + dt * new[i]
                    if new[i] > fastest[b, i] or new[i] < slowest[b, i] or impulse[b, i] != 0.0:
                        constrained = True
                    if budget_forward[b, i] > 0.0 or budget_backward[b, i] > 0.0:
                        constrained = True
                if constrained:
                    _invert(low, inverse, work, first, end)
                    _friction(inverse, new, impulse[b], budget_forward[b], budget_backward[b], slowest[b], fastest[b],
                              dt, first, end)  # fmt: skip
                changed = False
                for i in range(first, end):
                    mean = 0.5 * (velocity[b, i] + new[i])
                    torque[b, i] = give[i] - slope[i] * mean - soft[i] * new[i] / dt
                    torque[b, i] -= late[i] * (new[i] - velocity[b, i]) / dt
                    if state[i] != FIXED:
                        wanted = pull[b, i] - damping[b, i] * mean if state[i] != FREE else torque[b, i]
                        now = _limit_state(wanted, mean, i, b, limits)
                        if now != state[i]:
                            state[i] = now
                            changed = True
                if not changed:
                    break
            for i in range(first, end):
                acceleration[b, i] = (new[i] - velocity[b, i]) / dt


@jit
def end_stops(position, lower, upper, dt):
    """Slowest and fastest speed (B, n) that do not pass the end stops (n,) within a step from the positions (B, n)."""
    slowest, fastest = np.empty_like(position), np.empty_like(position)
    for b in range(position.shape[0]):
        for i in range(position.shape[1]):
            slowest[b, i] = min((lower[i] - position[b, i]) / dt, 0.0)
            fastest[b, i] = max((upper[i] - position[b, i]) / dt, 0.0)
    return slowest, fastest


@jit
def tightened(limits, given):
    """The drive's limits (5, B, n) and those of one more effect, five arrays (B, n), taken together."""
    out = limits.copy()
    for k in range(5):
        own = given[k]
        for b in range(own.shape[0]):
            for i in range(own.shape[1]):
                out[k, b, i] = min(out[k, b, i], own[b, i])
    return out


@jit
def within_limits(wanted, velocity, limits):
    """A wanted torque (B, n) as far as the drive's limits leave it at a speed (B, n)."""
    out = np.empty_like(wanted)
    for b in range(wanted.shape[0]):
        for i in range(wanted.shape[1]):
            top = min(limits[0, b, i], limits[4, b, i] * (1.0 - velocity[b, i] / limits[2, b, i]))
            bottom = min(limits[1, b, i], limits[4, b, i] * (1.0 + velocity[b, i] / limits[3, b, i]))
            out[b, i] = min(max(wanted[b, i], -bottom), top)
    return out


@jit
def _drive(state, i, b, pull, damping, fixed_torque, limits, give, slope):
    """The drive's torque as give - slope * mean velocity, in each of its states."""
    if state == FREE:
        give[i], slope[i] = pull[b, i], damping[b, i]
    elif state == FIXED:
        give[i], slope[i] = fixed_torque[b, i], 0.0
    elif state == TOP:
        give[i], slope[i] = limits[0, b, i], 0.0
    elif state == BOTTOM:
        give[i], slope[i] = -limits[1, b, i], 0.0
    elif state == FAST:
        slope[i] = limits[4, b, i] / limits[2, b, i]
        give[i] = limits[4, b, i]
    else:
        slope[i] = limits[4, b, i] / limits[3, b, i]
        give[i] = -limits[4, b, i]


@jit
def _limit_state(wanted, mean, i, b, limits):
    """Which limit of the drive a torque would break: the highest torque, or the line that falls with the speed."""
    ahead = limits[4, b, i] * (1.0 - mean / limits[2, b, i])
    behind = limits[4, b, i] * (1.0 + mean / limits[3, b, i])
    if wanted > min(limits[0, b, i], ahead):
        return TOP if limits[0, b, i] < ahead else FAST
    if wanted < -min(limits[1, b, i], behind):
        return BOTTOM if limits[1, b, i] < behind else BACK
    return FREE


@jit
def _factor(mass, diagonal, low, first, end):
    """Cholesky factor of one block of the mass matrix with this diagonal."""
    for i in range(first, end):
        for j in range(first, i + 1):
            s = diagonal[i] if i == j else mass[i, j]
            for k in range(first, j):
                s -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(max(s, 1e-300)) if i == j else s / low[j, j]


@jit
def _substitute(low, right, out, work, first, end):
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


@jit
def _invert(low, inverse, column, first, end):
    """Inverse of low low^T on one block."""
    for c in range(first, end):
        for i in range(first, end):
            s = 1.0 if i == c else 0.0
            for k in range(first, i):
                s -= low[i, k] * column[k]
            column[i] = s / low[i, i]
        for i in range(end - 1, first - 1, -1):
            s = column[i]
            for k in range(i + 1, end):
                s -= low[k, i] * inverse[k, c]
            inverse[i, c] = s / low[i, i]


@jit
def _friction(inverse, speed, impulse, forward, backward, slowest, fastest, dt, first, end):
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
