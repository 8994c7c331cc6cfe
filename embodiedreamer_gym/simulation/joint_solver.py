"""One step of the servo-driven joints: acceleration under half-step damping, drive limits and dry friction.

PyBullet integrates v += a dt, q += v dt, a leapfrog whose velocity belongs to t - dt/2. Damping is therefore taken
at the mean of the old and the new velocity, (M + R + (d + b) dt/2) a = p e - (d + b) v - h + load - friction,
which at 240 Hz agrees with an engine at 10 kHz. Friction is a stopping impulse, solved over the coupled joints by
projected Gauss-Seidel (Moreau's time stepping), because stopping joints one by one changes signs through the coupling.

If a gear is compliant, its motor is a separate mass, R (w' - w) / dt = drive - b w - gear, which depends on the joint
only through the joint's new velocity. It is eliminated joint by joint, so that gear and motor act on the joint as a
torque and a damping. Viscous friction then acts on the motor: behind a gear of ratio N, a motor's bearings count N^2
times (De Luca and Book, Robots with flexible elements, in Springer Handbook of Robotics, 2016). The gear's spring is
taken at its current deflection, like the servo's, as far as the step resolves its mode, and beyond that at its new
deflection; in a gap there is no spring.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from embodiedreamer_gym.robot.dynamics import UNWRAPPED, run_dynamics
from embodiedreamer_gym.simulation.block_solver import factor, invert, stop, substitute

RINGING = 3.0  # damping at the mean speed scales a velocity by (1 - x) / (1 + x) per step, x = dt slope / 2 inertia
PASSES = 4  # iterations over the set of joints whose drive is at a limit
GEAR_PASSES = 8  # iterations over the sides on which the teeth of gears with a gap touch
LEAST_ROTOR = 0.02  # least rotor inertia at a compliant gear, relative to the joint's inertia
RESOLVED = 0.5  # in inertia / dt^2: a gear's stiffness up to which it is explicit; the springs of n joints add up
RIGID = 1e6  # stiffness of teeth without compliance, relative to that which a step resolves
FREE, TOP, FAST, BOTTOM, BACK = 0, 1, 2, 3, 4
OPEN, AHEAD, BEHIND, MESHED = 0, 1, -1, 2
GIVE, SLOPE, DRAG, SOFT, LATE, HEAVY, KNOWN, PUSH, HOLD = range(9)  # rows of `parts`, which describe a joint's drive
FASTEST = 1e3  # rad/s; a simulation that diverges stays at this speed

jit = nb.njit(cache=True, nogil=True, error_model="numpy")
inner = nb.njit(nogil=True, error_model="numpy", **UNWRAPPED)


@jit
def within_limits(pull, damping, velocity, limits, out):
    """Write the servo's torque, pull - damping * velocity (B, n), within the drive's limits at that speed, to `out`.

    This and the functions below write to given arrays, because Numba unpickles the type of a returned array at each
    call.
    """
    for b in range(pull.shape[0]):
        for i in range(pull.shape[1]):
            top = min(limits[0, b, i], limits[4, b, i] * (1.0 - velocity[b, i] / limits[2, b, i]))
            bottom = min(limits[1, b, i], limits[4, b, i] * (1.0 + velocity[b, i] / limits[3, b, i]))
            out[b, i] = min(max(pull[b, i] - damping[b, i] * velocity[b, i], -bottom), top)


@jit
def move(position, velocity, acceleration, dt, moved):
    """Write position and velocity (2, B, n) after a free step of duration dt to `moved`; all others are (B, n)."""
    for b in range(position.shape[0]):
        for i in range(position.shape[1]):
            speed = velocity[b, i] + acceleration[b, i] * dt
            if speed > FASTEST:
                speed = FASTEST
            elif speed < -FASTEST:
                speed = -FASTEST
            moved[1, b, i] = speed
            moved[0, b, i] = position[b, i] + speed * dt


@jit
def step_joints(now, lanes, links, frames, masses, gravity, mass, bias, pull, load, line, friction, position, velocity, wound,
                spin, servo, limits, stops, gear, blocks, dt, impulse, solution):  # fmt: skip
    """Compute mass matrix and bias of the rigid bodies, in `mass` and `bias`, then `solve_step`.

    now: joint velocities at the instant of the positions (B, n), for the bias.

    This is one call instead of two, because calls from Python take a fifth of the time of a batch of one.
    """
    force = np.empty((len(position), len(links)))
    still = np.zeros_like(position)
    run_dynamics(lanes, position, now, still, links, frames, masses, gravity, mass, bias, force)
    solve_step(mass, bias, pull, load, line, friction, position, velocity, wound, spin, servo, limits, stops, gear, blocks, dt,
               impulse, solution)  # fmt: skip


@jit
def solve_step(mass, bias, pull, load, line, friction, position, velocity, wound, spin, servo, limits, stops, gear,
               blocks, dt, impulse, solution):  # fmt: skip
    """Solve one step for a batch of B samples of n joints.

    It is one loop instead of a function per part: passing tuples of arrays doubles the time at 60 samples.

    Args:
        mass: mass matrix (B, n, n), kg m^2.
        bias: gravity, centrifugal and Coriolis torque (B, n), N m.
        pull: the servo's stiffness times its position error (B, n), N m.
        load: extra torque on the joint (B, n), N m.
        line: gain and shift (2, B, n): of a drive torque x, gain x + shift reaches the joint; the gain is not negative.
        friction: highest friction in forward and in backward motion (2, B, n), N m.
        position: joint angles (B, n), rad.
        velocity: joint velocities half a step ago (B, n), rad/s.
        wound: the motor's angle minus the joint's (B, n), rad.
        spin: the motor's velocity half a step ago (B, n), rad/s.
        servo: stiffness, N m/rad, damping, N m s/rad, rotor inertia, kg m^2, and viscous friction, N m s/rad
            (4, B, n).
        limits: the drive's highest torque forward and backward, N m, the speeds at which it falls to zero, rad/s,
            and its torque at rest on that line, N m (5, B, n).
        stops: lower and upper end stops (2, n), rad.
        gear: compliance, rad/(N m), settling time, s, and half the gap, rad (3, B, n); (3, 0, 0) if all are rigid.
        blocks: first joint of each independent arm, then n.
        dt: duration of the step, s.
        impulse: friction's impulse of the last step (B, n), N m s, as the initial guess for this one.
        solution: out (4, B, n), acceleration, rad/s^2; the drive's torque at the mean velocity of the step, before the
            gain, N m; friction's impulse, N m s; the motor's new velocity, rad/s.
    """
    batch, n = velocity.shape
    gain, shift, forward, backward = line[0], line[1], friction[0], friction[1]
    stiffness, damping, rotor, viscous = servo[0], servo[1], servo[2], servo[3]
    solution[2], solution[3] = impulse, spin
    acceleration, torque, impulse, spin = solution[0], solution[1], solution[2], solution[3]
    low, inverse, parts = np.empty((n, n)), np.empty((n, n)), np.empty((9, n))
    rows, sides = np.empty((7, n)), np.empty((3, n), np.int64)
    diagonal, right, new, work, lone, slowest, fastest = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6]
    state, side, left = sides[0], sides[1], sides[2]
    gives = gear.shape[1] > 0
    for b in range(batch):
        for i in range(n):
            slowest[i] = min((stops[0, i] - position[b, i]) / dt, 0.0)  # does not pass an end stop in this step
            fastest[i] = max((stops[1, i] - position[b, i]) / dt, 0.0)
        for k in range(len(blocks) - 1):
            first, end = blocks[k], blocks[k + 1]
            for i in range(first, end):
                state[i] = FREE
            if gives:
                _at_first(gear[:, b], wound[b], mass[b], rotor[b], side, left, lone, low, inverse, work, first, end)
            for _ in range(GEAR_PASSES if gives else PASSES):
                for i in range(first, end):
                    _drive(state[i], i, b, pull, damping, limits, parts)
                    loose = gives and gear[0, b, i] + gear[2, b, i] > 0.0
                    viscosity, rubbing = (0.0, viscous[b, i]) if loose else (viscous[b, i], 0.0)  # joint, motor
                    own = mass[b, i, i] + 0.5 * dt * viscosity
                    base = max(rotor[b, i], LEAST_ROTOR * mass[b, i, i]) if loose else own + rotor[b, i]
                    heavy = _motor(state[i], i, base, gain[b, i], stiffness[b, i], rubbing, dt, parts)
                    given = gain[b, i] * parts[GIVE, i] + shift[b, i]
                    if loose:
                        slip = spin[b, i] - velocity[b, i]
                        still, grip = _gear(side[i], gear[0, b, i], gear[1, b, i], gear[2, b, i], wound[b, i], slip,
                                            base * lone[i] / (base + lone[i]), dt)  # fmt: skip
                        known = given + (base - 0.5 * dt * parts[DRAG, i] + parts[LATE, i]) * spin[b, i] / dt
                        _eliminate(i, heavy / dt, known, still, grip, parts)
                        diagonal[i] = own + dt * parts[HOLD, i]
                        drag, given = parts[HOLD, i], parts[PUSH, i]
                    else:
                        diagonal[i] = heavy
                        drag = parts[DRAG, i] + parts[SOFT, i] / dt
                    right[i] = given - (drag + viscosity) * velocity[b, i] - bias[b, i] + load[b, i]
                factor(mass[b], diagonal, low, first, end)
                substitute(low, right, new, work, first, end)
                constrained = False
                for i in range(first, end):
                    new[i] = velocity[b, i] + dt * new[i]
                    if new[i] > fastest[i] or new[i] < slowest[i] or impulse[b, i] != 0.0:
                        constrained = True
                    if forward[b, i] > 0.0 or backward[b, i] > 0.0:
                        constrained = True
                if constrained:
                    invert(low, inverse, first, end)
                    stop(inverse, new, impulse[b], forward[b], backward[b], slowest, fastest, dt, first, end)
                changed = False
                for i in range(first, end):
                    old, work[i] = velocity[b, i], new[i]
                    if gives and gear[0, b, i] + gear[2, b, i] > 0.0:
                        old = spin[b, i]
                        changed |= _turned(i, gear[2, b, i], wound[b, i], new[i], dt, parts, side, left, work)
                    mean = 0.5 * (old + work[i])
                    torque[b, i] = parts[GIVE, i] - parts[SLOPE, i] * mean
                    if parts[SOFT, i] + parts[LATE, i] > 0.0:
                        late = parts[SOFT, i] * work[i]
                        if parts[LATE, i] > 0.0:
                            late += parts[LATE, i] * gain[b, i] * parts[SLOPE, i] / parts[DRAG, i] * (work[i] - old)
                        torque[b, i] -= late / (dt * gain[b, i])
                    wanted = pull[b, i] - damping[b, i] * mean if state[i] != FREE else torque[b, i]
                    now = _limit_state(wanted, mean, i, b, limits)
                    if now != state[i]:
                        state[i] = now
                        changed = True
                if not changed:
                    break
            for i in range(first, end):
                acceleration[b, i] = (new[i] - velocity[b, i]) / dt
                if gives:
                    spin[b, i] = work[i]


@inner
def _drive(state, i, b, pull, damping, limits, parts):
    """The drive's torque as GIVE - SLOPE * mean velocity, in each of its states."""
    if state == FREE:
        parts[GIVE, i], parts[SLOPE, i] = pull[b, i], damping[b, i]
    elif state == TOP:
        parts[GIVE, i], parts[SLOPE, i] = limits[0, b, i], 0.0
    elif state == BOTTOM:
        parts[GIVE, i], parts[SLOPE, i] = -limits[1, b, i], 0.0
    elif state == FAST:
        parts[GIVE, i], parts[SLOPE, i] = limits[4, b, i], limits[4, b, i] / limits[2, b, i]
    else:
        parts[GIVE, i], parts[SLOPE, i] = -limits[4, b, i], limits[4, b, i] / limits[3, b, i]


@inner
def _motor(state, i, base, gain, stiffness, rubbing, dt, parts):
    """Inertia that a drive moves, with its damping; the parts that the step does not resolve become SOFT and LATE.

    rubbing: the motor's own viscous friction.
    """
    parts[DRAG, i] = drag = gain * parts[SLOPE, i] + rubbing
    parts[LATE, i] = late = max(0.0, 0.5 * dt * drag - RINGING * base)  # the rest acts at the new speed
    heavy = base + 0.5 * dt * drag + late
    stiff = gain * stiffness * dt * dt if state == FREE else 0.0
    parts[SOFT, i] = soft = max(0.0, stiff - heavy)  # a mode faster than the step resolves: implicit
    return heavy + soft


@inner
def _limit_state(wanted, mean, i, b, limits):
    """Which limit of the drive a torque would exceed: the highest torque, or the line that falls with the speed."""
    ahead = limits[4, b, i] * (1.0 - mean / limits[2, b, i])
    behind = limits[4, b, i] * (1.0 + mean / limits[3, b, i])
    if wanted > min(limits[0, b, i], ahead):
        return TOP if limits[0, b, i] < ahead else FAST
    if wanted < -min(limits[1, b, i], behind):
        return BOTTOM if limits[1, b, i] < behind else BACK
    return FREE


@inner
def _at_first(gear, wound, mass, rotor, side, left, lone, low, inverse, work, first, end):
    """Side on which teeth touch at the start of a step, and each joint's inertia if all other joints move freely."""
    for i in range(first, end):
        loose = gear[0, i] + gear[2, i] > 0.0
        lone[i] = mass[i, i] + (0.0 if loose else rotor[i])
        left[i], half = 0, gear[2, i]
        side[i] = MESHED if half == 0.0 else AHEAD if wound[i] >= half else BEHIND if wound[i] <= -half else OPEN
    factor(mass, lone, low, first, end)
    invert(low, inverse, first, end)
    for i in range(first, end):
        lone[i] = 1.0 / inverse[i, i]


@inner
def _gear(side, compliance, settling, half, wound, slip, inertia, dt):
    """A gear's torque as still + grip * (the motor's new velocity minus the joint's).

    slip: the old velocity difference; inertia: the reduced inertia of motor and joint.
    """
    if side == OPEN:
        return 0.0, 0.0
    spring = RIGID * inertia / (dt * dt)
    if compliance * spring > 1.0:
        spring = 1.0 / compliance
    damper = settling * spring
    mean = min(damper, 2.0 * inertia / dt)  # acts at the mean of both velocities, the rest at the new one
    grip = damper - 0.5 * mean + max(0.0, spring * dt - RESOLVED * inertia / dt)
    away = wound if side == MESHED else wound - side * half
    return spring * away + 0.5 * mean * slip, grip


@inner
def _eliminate(i, heavy, known, still, grip, parts):
    """A gear's torque as PUSH - HOLD * the joint's new velocity; the motor's one is (KNOWN - that torque) / HEAVY."""
    parts[HEAVY, i], parts[KNOWN, i] = heavy, known
    parts[PUSH, i] = (heavy * still + grip * known) / (heavy + grip)
    parts[HOLD, i] = heavy * grip / (heavy + grip)


@inner
def _turned(i, half, wound, joint, dt, parts, side, left, spin):
    """Compute a motor's new velocity from its joint's; return whether its gear's teeth must touch on another side.

    left: side that they have already left in this step, to which they do not return.
    """
    passed = parts[PUSH, i] - parts[HOLD, i] * joint
    spin[i] = (parts[KNOWN, i] - passed) / parts[HEAVY, i]
    old, wound = side[i], wound + dt * (spin[i] - joint)
    if old == MESHED:
        return False
    if old != OPEN:
        if passed * old < 0.0:
            side[i], left[i] = OPEN, left[i] + old
    elif wound > half and left[i] != AHEAD:
        side[i] = AHEAD
    elif wound < -half and left[i] != BEHIND:
        side[i] = BEHIND
    return side[i] != old
