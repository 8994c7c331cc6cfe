"""Compiled conversions between an engine's joints and the driven joints of a robot model."""

from __future__ import annotations

import numba as nb
import numpy as np

from embodiedreamer_gym.robot.dynamics import COORDINATE, run_dynamics


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def read_joints(position, velocity, to_position, to_velocity, shift, motion, linkage):
    """Driven joints and linkage forces, which are linear in the engine's joints (k,).

    Args:
        position, velocity: of the engine's joints (k,).
        to_position, to_velocity: matrices (n + k, k).
        shift: subtracted from the product of to_position and position (n + k,).
        motion: out, position and velocity of the driven joints (2, 1, n).
        linkage: out, forces (k,) that hold linked joints together.
    """
    n = motion.shape[2]
    for row in range(len(shift)):
        x, speed = 0.0, 0.0
        for i in range(len(position)):
            x += to_position[row, i] * position[i]
            speed += to_velocity[row, i] * velocity[i]
        x -= shift[row]
        if row < n:
            motion[0, 0, row], motion[1, 0, row] = x, speed
        else:
            linkage[row - n] = x + speed


@nb.njit(cache=True, nogil=True, error_model="numpy")
def joint_forces(
    lanes, position, velocity, acceleration, links, frames, masses, gravity, armature, linkage, order, out
):
    """Forces (k,) on the engine's joints, in its order, that give the driven joints an acceleration (1, n).

    Inverse dynamics of the engine's own masses, plus the armature's inertia (k,), minus the linkage's forces (k,).
    lanes: ONE; it is an argument because a constant would have another type, for which numba would compile again.
    """
    torque, force, none = np.empty_like(position), np.empty((1, len(links))), np.empty((0, 0, 0))
    run_dynamics(lanes, position, velocity, acceleration, links, frames, masses, gravity, none, torque, force)
    for i in range(len(order)):
        b = order[i]
        out[i] = force[0, b] - linkage[b] + armature[b] * acceleration[0, links[b, COORDINATE]]
