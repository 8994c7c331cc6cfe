"""One step of the servo-driven joints: acceleration under half-step damping, drive limits and dry friction.

PyBullet integrates v += a dt, q += v dt, a leapfrog whose velocity belongs to t - dt/2. Damping is therefore taken
at the mean of the old and the new velocity, (M + R + (d + b) dt/2) a = p e - (d + b) v - h + load - friction,
which at 240 Hz agrees with an engine at 10 kHz. Friction is a stopping impulse, solved over the coupled joints by
projected Gauss-Seidel (Moreau's time stepping), since a joint-by-joint stop flips signs through the coupling.

Where a gear gives way, its motor is a mass of its own, R (w' - w) / dt = drive - gear, which knows of the joint only
its new velocity: it is eliminated joint by joint, and what is left of gear and motor is a push and a damping of the
joint. The gear's spring is taken at its present wind-up, like the servo's, as far as the step resolves its mode, and
beyond that at its new one; in a gap there is none.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from embodiedreamer_gym.simulation.block_solver import factor, invert, stop, substitute

RINGING = 3.0  # damping at the mean speed turns a velocity by (1 - x) / (1 + x) per step, x = dt slope / 2 inertia
PASSES = 4  # over the set of joints whose drive is at a limit
GEAR_PASSES = 8  # over the sides on which gears with a gap touch
LEAST_ROTOR = 0.02  # of the joint's inertia, where a gear gives way
RESOLVED = 0.5  # inertia over squared step: up to it a gear's spring is explicit; n of them in a row add up
RIGID = 1e6  # of the stiffness that a step resolves: teeth without compliance
FREE, TOP, FAST, BOTTOM, BACK = 0, 1, 2, 3, 4
OPEN, AHEAD, BEHIND, MESHED = 0, 1, -1, 2
GIVE, SLOPE, DRAG, SOFT, LATE, HEAVY, KNOWN, PUSH, HOLD = range(9)  # parts of a joint's drive

jit = nb.njit(cache=True, nogil=True, error_model="numpy")


class Servo(NamedTuple):
    """The servos of a batch, arrays (B, n)."""

    stiffness: np.ndarray  # N m/rad
    damping: np.ndarray  # N m s/rad
    rotor: np.ndarray  # kg m^2
    viscous: np.ndarray  # N m s/rad, of the joint


class Loads(NamedTuple):
    """What acts on the joints in a step."""

    mass: np.ndarray  # mass matrix (B, n, n)
    bias: np.ndarray  # gravity, centrifugal and Coriolis torque (B, n), N m
    pull: np.ndarray  # stiffness times position error (B, n), N m
    load: np.ndarray  # extra torque on the joint (B, n), N m
    gain: np.ndarray  # a torque x of the drive arrives as gain x + shift (B, n); the gain is not negative
    shift: np.ndarray  # N m
    forward: np.ndarray  # highest friction (B, n) in forward motion, N m
    backward: np.ndarray  # and in backward motion


class Motion(NamedTuple):
    """How the joints move as a step begins, arrays (B, n)."""

    position: np.ndarray  # rad
    velocity: np.ndarray  # rad/s, of half a step ago
    wound: np.ndarray  # the motor's angle less the joint's, rad
    spin: np.ndarray  # the motor's velocity; the new one when the step is solved


class Work(NamedTuple):
    """Arrays that a step writes to: results (B, n), and what is needed for one joint after the other."""

    impulse: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    low: np.ndarray
    inverse: np.ndarray
    diagonal: np.ndarray
    right: np.ndarray
    new: np.ndarray
    column: np.ndarray
    lone: np.ndarray
    slowest: np.ndarray
    fastest: np.ndarray
    parts: np.ndarray
    state: np.ndarray
    side: np.ndarray
    left: np.ndarray


@jit
def solve_step(mass, bias, pull, load, line, friction, position, velocity, wound, spin, servo, limits, stops, gear,
               blocks, dt, impulse):  # fmt: skip
    """Solve one step for a batch: acceleration (B, n), torque (B, n) of the drive, impulse (B, n), motors' velocity.

    See `Loads`, `Motion` and `Servo`; line (2, B, n): gain and shift; friction (2, B, n); servo (4, B, n);
    limits (5, B, n): the drive's highest torque forward and backward, N m, the speeds at which it fades to nothing, rad/s,
    and its torque at rest on that line, N m; stops (2, n): end stops; gear (3, B, n): compliance, rad/(N m), settling time,
    s, and half the gap, rad, or of no samples where no gear gives way; blocks: first joint of each independent arm, then
    n; impulse: friction's of the last step (a warm start). The torque is that at the mean velocity of the step, before
    the gain. Arrays are passed instead of the tuples because a call unpacks them in half the time.
    """
    batch, n = velocity.shape
    loads = Loads(mass, bias, pull, load, line[0], line[1], friction[0], friction[1])
    motion = Motion(position, velocity, wound, spin.copy())
    square, rows, marks = np.empty((2, n, n)), np.empty((16, n)), np.empty((3, n), np.int64)
    work = Work(impulse.copy(), np.empty((batch, n)), np.empty((batch, n)), square[0], square[1], rows[0], rows[1], rows[2],
                rows[3], rows[4], rows[5], rows[6], rows[7:], marks[0], marks[1], marks[2])  # fmt: skip
    servos = Servo(servo[0], servo[1], servo[2], servo[3])
    for b in range(batch):
        for i in range(n):
            work.slowest[i] = min((stops[0, i] - position[b, i]) / dt, 0.0)  # that do not pass an end stop in a step
            work.fastest[i] = max((stops[1, i] - position[b, i]) / dt, 0.0)
        for k in range(len(blocks) - 1):
            _solve_arm(b, blocks[k], blocks[k + 1], loads, motion, servos, limits, gear, dt, work)
    return work.acceleration, work.torque, work.impulse, motion.spin


@jit
def _solve_arm(b, first, end, loads, motion, servo, limits, gear, dt, work):
    """Solve one arm of one sample, until each joint's drive and gear are in the state that they were taken to be in."""
    gives = gear.shape[1] > 0
    low, new, velocity, impulse = work.low, work.new, motion.velocity[b], work.impulse[b]
    for i in range(first, end):
        work.state[i] = FREE
    if gives:
        _at_first(gear[:, b], motion.wound[b], loads.mass[b], servo.rotor[b], work, first, end)
    for _ in range(GEAR_PASSES if gives else PASSES):
        for i in range(first, end):
            _assemble(b, i, loads, motion, servo, limits, gear, dt, work)
        factor(loads.mass[b], work.diagonal, low, first, end)
        substitute(low, work.right, new, work.column, first, end)
        constrained = False
        for i in range(first, end):
            new[i] = velocity[i] + dt * new[i]
            if new[i] > work.fastest[i] or new[i] < work.slowest[i] or impulse[i] != 0.0:
                constrained = True
            if loads.forward[b, i] > 0.0 or loads.backward[b, i] > 0.0:
                constrained = True
        if constrained:
            invert(low, work.inverse, work.column, first, end)
            stop(work.inverse, new, impulse, loads.forward[b], loads.backward[b], work.slowest, work.fastest, dt,
                      first, end)  # fmt: skip
        if not _states_changed(b, first, end, loads, motion, servo, limits, gear, dt, work):
            break
    for i in range(first, end):
        work.acceleration[b, i] = (new[i] - velocity[i]) / dt
        if gives:
            motion.spin[b, i] = work.column[i]


@jit
def _assemble(b, i, loads, motion, servo, limits, gear, dt, work):
    """A joint's diagonal of the mass matrix and right-hand side, with its drive and gear in their present states."""
    parts, mass, rotor = work.parts, loads.mass[b, i, i], servo.rotor[b, i]
    _drive(work.state[i], i, b, loads.pull, servo.damping, limits, parts)
    own, viscosity = mass + 0.5 * dt * servo.viscous[b, i], servo.viscous[b, i]
    loose = gear.shape[1] > 0 and gear[0, b, i] + gear[2, b, i] > 0.0
    base = max(rotor, LEAST_ROTOR * mass) if loose else own + rotor
    heavy = _motor(work.state[i], i, base, loads.gain[b, i], servo.stiffness[b, i], dt, parts)
    given = loads.gain[b, i] * parts[GIVE, i] + loads.shift[b, i]
    if loose:
        slip = motion.spin[b, i] - motion.velocity[b, i]
        pair = base * work.lone[i] / (base + work.lone[i])
        still, grip = _gear(
            work.side[i], gear[0, b, i], gear[1, b, i], gear[2, b, i], motion.wound[b, i], slip, pair, dt
        )
        known = given + (base - 0.5 * dt * parts[DRAG, i] + parts[LATE, i]) * motion.spin[b, i] / dt
        _eliminate(i, heavy / dt, known, still, grip, parts)
        work.diagonal[i] = own + dt * parts[HOLD, i]
        drag, given = parts[HOLD, i], parts[PUSH, i]
    else:
        work.diagonal[i] = heavy
        drag = parts[DRAG, i] + parts[SOFT, i] / dt
    work.right[i] = given - (drag + viscosity) * motion.velocity[b, i] - loads.bias[b, i] + loads.load[b, i]


@jit
def _states_changed(b, first, end, loads, motion, servo, limits, gear, dt, work):
    """The drive's torques at the new velocities; whether a drive or a gear must be taken to be in another state."""
    changed, gives, parts = False, gear.shape[1] > 0, work.parts
    for i in range(first, end):
        old, work.column[i] = motion.velocity[b, i], work.new[i]
        if gives and gear[0, b, i] + gear[2, b, i] > 0.0:
            old = motion.spin[b, i]
            changed |= _turned(i, gear[2, b, i], motion.wound[b, i], dt, work)
        mean = 0.5 * (old + work.column[i])
        work.torque[b, i] = parts[GIVE, i] - parts[SLOPE, i] * mean
        if parts[SOFT, i] + parts[LATE, i] > 0.0:
            late = parts[SOFT, i] * work.column[i] + parts[LATE, i] * (work.column[i] - old)
            work.torque[b, i] -= late / (dt * loads.gain[b, i])
        free = work.state[i] == FREE
        wanted = work.torque[b, i] if free else loads.pull[b, i] - servo.damping[b, i] * mean
        state = _limit_state(wanted, mean, i, b, limits)
        if state != work.state[i]:
            work.state[i] = state
            changed = True
    return changed


@jit
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


@jit
def _motor(state, i, base, gain, stiffness, dt, parts):
    """What a drive makes of the inertia that it moves; its share beyond what the step resolves as SOFT and LATE."""
    parts[DRAG, i] = drag = gain * parts[SLOPE, i]
    parts[LATE, i] = late = max(0.0, 0.5 * dt * drag - RINGING * base)  # beyond it: a later speed
    heavy = base + 0.5 * dt * drag + late
    stiff = gain * stiffness * dt * dt if state == FREE else 0.0
    parts[SOFT, i] = soft = max(0.0, stiff - heavy)  # a mode faster than the step resolves: implicit
    return heavy + soft


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
def _at_first(gear, wound, mass, rotor, work, first, end):
    """On which side teeth touch as a step begins, and a joint's inertia where all other joints follow it freely."""
    for i in range(first, end):
        loose = gear[0, i] + gear[2, i] > 0.0
        work.lone[i] = mass[i, i] + (0.0 if loose else rotor[i])
        work.left[i], half = 0, gear[2, i]
        work.side[i] = MESHED if half == 0.0 else AHEAD if wound[i] >= half else BEHIND if wound[i] <= -half else OPEN
    factor(mass, work.lone, work.low, first, end)
    invert(work.low, work.inverse, work.column, first, end)
    for i in range(first, end):
        work.lone[i] = 1.0 / work.inverse[i, i]


@jit
def _gear(side, compliance, settling, half, wound, slip, inertia, dt):
    """A gear's torque as still + grip * (the motor's new velocity less the joint's).

    slip: the old one; inertia: that of motor and joint against each other.
    """
    if side == OPEN:
        return 0.0, 0.0
    spring = RIGID * inertia / (dt * dt)
    if compliance * spring > 1.0:
        spring = 1.0 / compliance
    damper = settling * spring
    mean = min(damper, 2.0 * inertia / dt)  # at the mean of both velocities, what is beyond at the new one
    grip = damper - 0.5 * mean + max(0.0, spring * dt - RESOLVED * inertia / dt)
    away = wound if side == MESHED else wound - side * half
    return spring * away + 0.5 * mean * slip, grip


@jit
def _eliminate(i, heavy, known, still, grip, parts):
    """A gear's torque as PUSH - HOLD * the joint's new velocity; the motor's is (KNOWN - that torque) / HEAVY."""
    parts[HEAVY, i], parts[KNOWN, i] = heavy, known
    parts[PUSH, i] = (heavy * still + grip * known) / (heavy + grip)
    parts[HOLD, i] = heavy * grip / (heavy + grip)


@jit
def _turned(i, half, wound, dt, work):
    """Find a motor's new velocity (into `column`) from its joint's; whether its gear's teeth must touch on another side.

    Teeth do not return in a step to the side that they have left in it already.
    """
    parts, joint, spin, side, left = work.parts, work.new[i], work.column, work.side, work.left
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
