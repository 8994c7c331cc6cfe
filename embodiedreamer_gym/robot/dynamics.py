"""Rigid-body dynamics of a batch of robots, compiled: mass matrix, bias torque, inverse dynamics, pose.

Composite-rigid-body and recursive Newton-Euler algorithms (Featherstone, Rigid Body Dynamics Algorithms, 2008,
chapters 5 and 6), with every spatial vector taken at the world's origin, so that inertias and forces just add.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from embodiedreamer_gym.robot.tree import KinematicTree

jit = nb.njit(cache=True, nogil=True, error_model="numpy")


@jit
def _multiply(a, b, out):
    for r in range(3):
        for c in range(3):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]


@jit
def _rodrigues(axis, angle, out):
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d


@jit
def _place(i, x, parent, rotation, origin, axis, prismatic, turned, placed, screw, frame, spin):
    """World pose of body i at joint value x, and the unit screw of its joint at the world's origin."""
    up = parent[i]
    if up < 0:
        for r in range(3):
            placed[i, r] = origin[i, r]
            for c in range(3):
                frame[r, c] = rotation[i, r, c]
    else:
        _multiply(turned[up], rotation[i], frame)
        for r in range(3):
            t = turned[up]
            placed[i, r] = t[r, 0] * origin[i, 0] + t[r, 1] * origin[i, 1] + t[r, 2] * origin[i, 2] + placed[up, r]
    d0 = frame[0, 0] * axis[i, 0] + frame[0, 1] * axis[i, 1] + frame[0, 2] * axis[i, 2]
    d1 = frame[1, 0] * axis[i, 0] + frame[1, 1] * axis[i, 1] + frame[1, 2] * axis[i, 2]
    d2 = frame[2, 0] * axis[i, 0] + frame[2, 1] * axis[i, 1] + frame[2, 2] * axis[i, 2]
    if prismatic[i]:
        for r in range(3):
            for c in range(3):
                turned[i, r, c] = frame[r, c]
        placed[i, 0] += x * d0
        placed[i, 1] += x * d1
        placed[i, 2] += x * d2
        screw[i, 0], screw[i, 1], screw[i, 2] = 0.0, 0.0, 0.0
        screw[i, 3], screw[i, 4], screw[i, 5] = d0, d1, d2
    else:
        _rodrigues(axis[i], x, spin)
        _multiply(frame, spin, turned[i])
        screw[i, 0], screw[i, 1], screw[i, 2] = d0, d1, d2
        screw[i, 3] = placed[i, 1] * d2 - placed[i, 2] * d1
        screw[i, 4] = placed[i, 2] * d0 - placed[i, 0] * d2
        screw[i, 5] = placed[i, 0] * d1 - placed[i, 1] * d0


@jit
def _momentum(mass, moment, inertia, motion, out):
    """Spatial inertia (mass, first moment, inertia at the origin) times a motion (angular, linear)."""
    m0, m1, m2 = moment[0], moment[1], moment[2]
    w0, w1, w2 = motion[0], motion[1], motion[2]
    v0, v1, v2 = motion[3], motion[4], motion[5]
    out[0] = inertia[0, 0] * w0 + inertia[0, 1] * w1 + inertia[0, 2] * w2 + m1 * v2 - m2 * v1
    out[1] = inertia[1, 0] * w0 + inertia[1, 1] * w1 + inertia[1, 2] * w2 + m2 * v0 - m0 * v2
    out[2] = inertia[2, 0] * w0 + inertia[2, 1] * w1 + inertia[2, 2] * w2 + m0 * v1 - m1 * v0
    out[3] = mass * v0 - (m1 * w2 - m2 * w1)
    out[4] = mass * v1 - (m2 * w0 - m0 * w2)
    out[5] = mass * v2 - (m0 * w1 - m1 * w0)


@jit
def _world_inertia(turned, placed, mass, moment_b, inertia_b, moment, inertia, half, turned_moment):
    """A body's first moment and inertia at the world's origin."""
    _multiply(turned, inertia_b, half)
    along = 0.0
    for r in range(3):
        turned_moment[r] = turned[r, 0] * moment_b[0] + turned[r, 1] * moment_b[1] + turned[r, 2] * moment_b[2]
        moment[r] = turned_moment[r] + mass * placed[r]
        along += placed[r] * (2.0 * turned_moment[r] + mass * placed[r])
    for r in range(3):
        for c in range(3):
            value = half[r, 0] * turned[c, 0] + half[r, 1] * turned[c, 1] + half[r, 2] * turned[c, 2]
            value -= placed[r] * turned_moment[c] + turned_moment[r] * placed[c] + mass * placed[r] * placed[c]
            inertia[r, c] = value
        inertia[r, r] += along


@jit
def _kernel(q, v, a, parent, rotation, origin, axis, prismatic, coordinate, gain, offset, body_arm,
            mass, moment_b, inertia_b, gravity, with_matrix, matrix, bias, body_force):  # fmt: skip
    batch, n = q.shape
    k = parent.shape[0]
    many, many_g = mass.shape[0], gravity.shape[0]
    turned, placed, screw = np.empty((k, 3, 3)), np.empty((k, 3)), np.empty((k, 6))
    speed, accel, force = np.empty((k, 6)), np.empty((k, 6)), np.empty((k, 6))
    moment, inertia, total = np.empty((k, 3)), np.empty((k, 3, 3)), np.empty(k)
    scratch, half, momentum, column, spare = np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6), np.empty(3)
    for b in range(batch):
        bm = b % many
        bg = b % many_g
        for i in range(k):
            c, g, up = coordinate[i], gain[i], parent[i]
            _place(i, g * q[b, c] + offset[i], parent, rotation, origin, axis, prismatic, turned, placed, screw, scratch, half)
            rate, push = g * v[b, c], g * a[b, c]
            for r in range(6):
                speed[i, r] = screw[i, r] * rate + (speed[up, r] if up >= 0 else 0.0)
                accel[i, r] = screw[i, r] * push + (accel[up, r] if up >= 0 else 0.0)
            if up < 0:
                for r in range(3):
                    accel[i, 3 + r] -= gravity[bg, body_arm[i], r]
            w, u, s = speed[i, :3], speed[i, 3:], screw[i]
            accel[i, 0] += rate * (w[1] * s[2] - w[2] * s[1])
            accel[i, 1] += rate * (w[2] * s[0] - w[0] * s[2])
            accel[i, 2] += rate * (w[0] * s[1] - w[1] * s[0])
            accel[i, 3] += rate * (w[1] * s[5] - w[2] * s[4] + u[1] * s[2] - u[2] * s[1])
            accel[i, 4] += rate * (w[2] * s[3] - w[0] * s[5] + u[2] * s[0] - u[0] * s[2])
            accel[i, 5] += rate * (w[0] * s[4] - w[1] * s[3] + u[0] * s[1] - u[1] * s[0])
            total[i] = mass[bm, i]
            _world_inertia(turned[i], placed[i], mass[bm, i], moment_b[bm, i], inertia_b[bm, i], moment[i], inertia[i], half, spare)
            _momentum(total[i], moment[i], inertia[i], speed[i], momentum)
            _momentum(total[i], moment[i], inertia[i], accel[i], force[i])
            p = momentum
            force[i, 0] += w[1] * p[2] - w[2] * p[1] + u[1] * p[5] - u[2] * p[4]
            force[i, 1] += w[2] * p[0] - w[0] * p[2] + u[2] * p[3] - u[0] * p[5]
            force[i, 2] += w[0] * p[1] - w[1] * p[0] + u[0] * p[4] - u[1] * p[3]
            force[i, 3] += w[1] * p[5] - w[2] * p[4]
            force[i, 4] += w[2] * p[3] - w[0] * p[5]
            force[i, 5] += w[0] * p[4] - w[1] * p[3]
        bias[b, :] = 0.0
        if with_matrix:
            matrix[b, :, :] = 0.0
        for i in range(k - 1, -1, -1):
            c, g, up = coordinate[i], gain[i], parent[i]
            along = 0.0
            for r in range(6):
                along += screw[i, r] * force[i, r]
            body_force[b, i] = along
            bias[b, c] += g * along
            if with_matrix:
                _momentum(total[i], moment[i], inertia[i], screw[i], column)
                along = 0.0
                for r in range(6):
                    along += screw[i, r] * column[r]
                matrix[b, c, c] += g * g * along
                above = up
                while above >= 0:
                    along = 0.0
                    for r in range(6):
                        along += screw[above, r] * column[r]
                    d = coordinate[above]
                    matrix[b, c, d] += g * gain[above] * along
                    matrix[b, d, c] += g * gain[above] * along
                    above = parent[above]
            if up >= 0:
                for r in range(6):
                    force[up, r] += force[i, r]
                if with_matrix:
                    total[up] += total[i]
                    for r in range(3):
                        moment[up, r] += moment[i, r]
                        for t in range(3):
                            inertia[up, r, t] += inertia[i, r, t]


class RigidBodies:
    """Dynamics of a tree; every call takes a batch (B, n) and mechanics whose leading axis divides B.

    mass (Bm, k), first_moment (Bm, k, 3), inertia (Bm, k, 3, 3), gravity (Bg, arms, 3): sample b uses row b mod Bm.
    """

    def __init__(self, tree: KinematicTree) -> None:
        self.tree = tree
        branch = tree.arm[tree.coordinate]
        self._fixed = (tree.parent, tree.rotation, tree.origin, tree.axis, tree.prismatic, tree.coordinate,
                       tree.gain, tree.offset, branch)  # fmt: skip

    def mass_matrix_and_bias(self, q, v, mechanics) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix (B, n, n) and bias torque (B, n): gravity, centrifugal and Coriolis; N m."""
        batch, n = q.shape
        matrix, bias = np.empty((batch, n, n)), np.empty((batch, n))
        force = np.empty((batch, self.tree.bodies))
        _kernel(q, v, np.zeros_like(q), *self._fixed, mechanics.mass, mechanics.first_moment, mechanics.inertia,
                mechanics.gravity, True, matrix, bias, force)  # fmt: skip
        return matrix, bias

    def inverse_dynamics(self, q, v, a, mechanics) -> tuple[np.ndarray, np.ndarray]:
        """Torque (B, n) that makes the acceleration a, and the same for each body's joint (B, k)."""
        batch, n = q.shape
        torque, force = np.empty((batch, n)), np.empty((batch, self.tree.bodies))
        _kernel(q, v, a, *self._fixed, mechanics.mass, mechanics.first_moment, mechanics.inertia,
                mechanics.gravity, False, np.empty((1, 1, 1)), torque, force)  # fmt: skip
        return torque, force
