"""Rigid-body dynamics of a batch of robots, compiled: mass matrix, bias torque, inverse dynamics, pose.

Composite-rigid-body and recursive Newton-Euler algorithms (Featherstone, Rigid Body Dynamics Algorithms, 2008,
chapters 5 and 6), with every spatial vector taken at the world's origin, so that inertias and forces just add.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

from embodiedreamer_gym.effects import Mechanics
from embodiedreamer_gym.robot.tree import KinematicTree

LANES = (0,) * 8  # samples computed side by side, so that the compiler can use vector instructions:
ONE = (0,)  # the length of a tuple is part of its type, hence a constant of the compiled loops

PARENT, COORDINATE, SLIDES, ARM = range(4)  # columns of a tree's links
ORIGIN, AXIS, GAIN, OFFSET = 9, 12, 15, 16  # columns of its frames, after the nine of the rotation
NO_MATRIX = np.empty((0, 0, 0))
Masses = tuple[np.ndarray, np.ndarray]  # of `RigidBodies.pack`
UPPER = [0, 1, 2, 4, 5, 8]  # independent entries of an inertia (3, 3)

UNWRAPPED: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # for calls from compiled code only
jit = nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
inner = nb.njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True, **UNWRAPPED)


@inner
def _place(lanes, i, x, sin, cos, links, frames, turned, placed, screw):
    """World rotation (9, L) and origin (3, L) of body i at joint values x (L,), and its joint's screw (6, L)."""
    up, slides, frame = links[i, PARENT], links[i, SLIDES] > 0, frames[i]
    a0, a1, a2 = frame[AXIS], frame[AXIS + 1], frame[AXIS + 2]
    for r in range(3):
        for l in range(len(lanes)):
            if up < 0:
                f0, f1, f2 = frame[3 * r], frame[3 * r + 1], frame[3 * r + 2]
                o = frame[ORIGIN + r]
            else:
                t0, t1, t2 = turned[up, 3 * r, l], turned[up, 3 * r + 1, l], turned[up, 3 * r + 2, l]
                f0 = t0 * frame[0] + t1 * frame[3] + t2 * frame[6]
                f1 = t0 * frame[1] + t1 * frame[4] + t2 * frame[7]
                f2 = t0 * frame[2] + t1 * frame[5] + t2 * frame[8]
                o = t0 * frame[ORIGIN] + t1 * frame[ORIGIN + 1] + t2 * frame[ORIGIN + 2] + placed[up, r, l]
            along = f0 * a0 + f1 * a1 + f2 * a2
            screw[i, r, l] = along
            if slides:
                placed[i, r, l] = o + x[l] * along
                turned[i, 3 * r, l], turned[i, 3 * r + 1, l], turned[i, 3 * r + 2, l] = f0, f1, f2
            else:  # Rodrigues: row f of the frame times the rotation about the axis
                placed[i, r, l] = o
                s, c = sin[l], cos[l]
                d = (1.0 - c) * along
                turned[i, 3 * r, l] = c * f0 + s * (f1 * a2 - f2 * a1) + d * a0
                turned[i, 3 * r + 1, l] = c * f1 + s * (f2 * a0 - f0 * a2) + d * a1
                turned[i, 3 * r + 2, l] = c * f2 + s * (f0 * a1 - f1 * a0) + d * a2
    for l in range(len(lanes)):
        d0, d1, d2 = screw[i, 0, l], screw[i, 1, l], screw[i, 2, l]
        p0, p1, p2 = placed[i, 0, l], placed[i, 1, l], placed[i, 2, l]
        if slides:
            screw[i, 0, l], screw[i, 1, l], screw[i, 2, l] = 0.0, 0.0, 0.0
            screw[i, 3, l], screw[i, 4, l], screw[i, 5, l] = d0, d1, d2
        else:
            screw[i, 3, l], screw[i, 4, l], screw[i, 5, l] = p1 * d2 - p2 * d1, p2 * d0 - p0 * d2, p0 * d1 - p1 * d0


@inner
def _inertia(lanes, i, samples, bodies, turned, placed, total):
    """Mass, first moment and inertia (xx, xy, xz, yy, yz, zz) of body i at the world's origin, (10, L)."""
    for l in range(len(lanes)):
        own = bodies[samples[l], i]
        m = own[0]
        t00, t01, t02 = turned[i, 0, l], turned[i, 1, l], turned[i, 2, l]
        t10, t11, t12 = turned[i, 3, l], turned[i, 4, l], turned[i, 5, l]
        t20, t21, t22 = turned[i, 6, l], turned[i, 7, l], turned[i, 8, l]
        p0, p1, p2 = placed[i, 0, l], placed[i, 1, l], placed[i, 2, l]
        c0, c1, c2 = own[1], own[2], own[3]
        h0, h1, h2 = t00 * c0 + t01 * c1 + t02 * c2, t10 * c0 + t11 * c1 + t12 * c2, t20 * c0 + t21 * c1 + t22 * c2
        xx, xy, xz = own[4], own[5], own[6]
        yy, yz, zz = own[7], own[8], own[9]
        u0, u1, u2 = t00 * xx + t01 * xy + t02 * xz, t00 * xy + t01 * yy + t02 * yz, t00 * xz + t01 * yz + t02 * zz
        v0, v1, v2 = t10 * xx + t11 * xy + t12 * xz, t10 * xy + t11 * yy + t12 * yz, t10 * xz + t11 * yz + t12 * zz
        w0, w1, w2 = t20 * xx + t21 * xy + t22 * xz, t20 * xy + t21 * yy + t22 * yz, t20 * xz + t21 * yz + t22 * zz
        q0, q1, q2 = 2.0 * h0 + m * p0, 2.0 * h1 + m * p1, 2.0 * h2 + m * p2
        trace = p0 * q0 + p1 * q1 + p2 * q2
        total[i, 0, l] = m
        total[i, 1, l], total[i, 2, l], total[i, 3, l] = h0 + m * p0, h1 + m * p1, h2 + m * p2
        total[i, 4, l] = u0 * t00 + u1 * t01 + u2 * t02 + trace - p0 * q0
        total[i, 5, l] = u0 * t10 + u1 * t11 + u2 * t12 - (p0 * h1 + h0 * p1 + m * p0 * p1)
        total[i, 6, l] = u0 * t20 + u1 * t21 + u2 * t22 - (p0 * h2 + h0 * p2 + m * p0 * p2)
        total[i, 7, l] = v0 * t10 + v1 * t11 + v2 * t12 + trace - p1 * q1
        total[i, 8, l] = v0 * t20 + v1 * t21 + v2 * t22 - (p1 * h2 + h1 * p2 + m * p1 * p2)
        total[i, 9, l] = w0 * t20 + w1 * t21 + w2 * t22 + trace - p2 * q2


@inner
def _momentum(lanes, i, total, motion, out):
    """Spatial inertia (10, L) of body i times a motion (6, L), angular then linear."""
    for l in range(len(lanes)):
        m, m0, m1, m2 = total[i, 0, l], total[i, 1, l], total[i, 2, l], total[i, 3, l]
        xx, xy, xz = total[i, 4, l], total[i, 5, l], total[i, 6, l]
        yy, yz, zz = total[i, 7, l], total[i, 8, l], total[i, 9, l]
        w0, w1, w2 = motion[i, 0, l], motion[i, 1, l], motion[i, 2, l]
        v0, v1, v2 = motion[i, 3, l], motion[i, 4, l], motion[i, 5, l]
        out[0, l] = xx * w0 + xy * w1 + xz * w2 + m1 * v2 - m2 * v1
        out[1, l] = xy * w0 + yy * w1 + yz * w2 + m2 * v0 - m0 * v2
        out[2, l] = xz * w0 + yz * w1 + zz * w2 + m0 * v1 - m1 * v0
        out[3, l] = m * v0 - (m1 * w2 - m2 * w1)
        out[4, l] = m * v1 - (m2 * w0 - m0 * w2)
        out[5, l] = m * v2 - (m0 * w1 - m1 * w0)


@inner
def _motion(lanes, i, up, rate, push, gravity, groups, arm, screw, speed, accel):
    """Velocity and acceleration (6, L) of body i from its parent's; gravity acts as an acceleration of the world."""
    for r in range(6):
        for l in range(len(lanes)):
            speed[i, r, l] = screw[i, r, l] * rate[l] + (speed[up, r, l] if up >= 0 else 0.0)
            below = accel[up, r, l] if up >= 0 else (-gravity[groups[l], arm, r - 3] if r >= 3 else 0.0)
            accel[i, r, l] = screw[i, r, l] * push[l] + below
    for l in range(len(lanes)):
        x = rate[l]
        w0, w1, w2 = speed[i, 0, l], speed[i, 1, l], speed[i, 2, l]
        u0, u1, u2 = speed[i, 3, l], speed[i, 4, l], speed[i, 5, l]
        s0, s1, s2 = screw[i, 0, l], screw[i, 1, l], screw[i, 2, l]
        s3, s4, s5 = screw[i, 3, l], screw[i, 4, l], screw[i, 5, l]
        accel[i, 0, l] += x * (w1 * s2 - w2 * s1)
        accel[i, 1, l] += x * (w2 * s0 - w0 * s2)
        accel[i, 2, l] += x * (w0 * s1 - w1 * s0)
        accel[i, 3, l] += x * (w1 * s5 - w2 * s4 + u1 * s2 - u2 * s1)
        accel[i, 4, l] += x * (w2 * s3 - w0 * s5 + u2 * s0 - u0 * s2)
        accel[i, 5, l] += x * (w0 * s4 - w1 * s3 + u0 * s1 - u1 * s0)


@inner
def _force(lanes, i, total, speed, accel, momentum, force):
    """Force (6, L) that body i needs: inertia times acceleration, and velocity cross momentum."""
    _momentum(lanes, i, total, speed, momentum)
    _momentum(lanes, i, total, accel, force[i])
    for l in range(len(lanes)):
        w0, w1, w2 = speed[i, 0, l], speed[i, 1, l], speed[i, 2, l]
        u0, u1, u2 = speed[i, 3, l], speed[i, 4, l], speed[i, 5, l]
        p0, p1, p2 = momentum[0, l], momentum[1, l], momentum[2, l]
        p3, p4, p5 = momentum[3, l], momentum[4, l], momentum[5, l]
        force[i, 0, l] += w1 * p2 - w2 * p1 + u1 * p5 - u2 * p4
        force[i, 1, l] += w2 * p0 - w0 * p2 + u2 * p3 - u0 * p5
        force[i, 2, l] += w0 * p1 - w1 * p0 + u0 * p4 - u1 * p3
        force[i, 3, l] += w1 * p5 - w2 * p4
        force[i, 4, l] += w2 * p3 - w0 * p5
        force[i, 5, l] += w0 * p4 - w1 * p3


@inner
def _dot(lanes, a, b, out):
    """Sums (L,) of the products of two spatial vectors (6, L)."""
    for l in range(len(lanes)):
        out[l] = a[0, l] * b[0, l] + a[1, l] * b[1, l] + a[2, l] * b[2, l]
    for l in range(len(lanes)):
        out[l] += a[3, l] * b[3, l] + a[4, l] * b[4, l] + a[5, l] * b[5, l]


@jit
def run_dynamics(lanes, q, v, a, links, frames, bodies, gravity, matrix, bias, body_force):
    """Compute the mass matrix (B, n, n), unless it is empty, and torques (B, n) and (B, k) for the motion q, v, a."""
    batch, k, with_matrix = q.shape[0], len(links), len(matrix) > 0
    turned, placed, total = np.empty((k, 9, len(lanes))), np.empty((k, 3, len(lanes))), np.empty((k, 10, len(lanes)))
    vectors, momentum, rows = np.empty((4, k, 6, len(lanes))), np.empty((6, len(lanes))), np.empty((6, len(lanes)))
    screw, speed, accel, force = vectors[0], vectors[1], vectors[2], vectors[3]
    x, sin, cos, rate, push, along = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    samples, groups = np.empty(len(lanes), np.int64), np.empty(len(lanes), np.int64)
    for first in range(0, batch, len(lanes)):
        count = min(len(lanes), batch - first)
        for l in range(len(lanes)):
            b = first + min(l, count - 1)  # the last sample fills the lanes that are left over
            samples[l], groups[l] = b % len(bodies), b % len(gravity)
        for i in range(k):
            c, g, offset = links[i, COORDINATE], frames[i, GAIN], frames[i, OFFSET]
            for l in range(len(lanes)):
                b = first + min(l, count - 1)
                x[l], rate[l], push[l] = g * q[b, c] + offset, g * v[b, c], g * a[b, c]
                sin[l], cos[l] = np.sin(x[l]), np.cos(x[l])
            _place(lanes, i, x, sin, cos, links, frames, turned, placed, screw)
            _inertia(lanes, i, samples, bodies, turned, placed, total)
            _motion(lanes, i, links[i, PARENT], rate, push, gravity, groups, links[i, ARM], screw, speed, accel)
            _force(lanes, i, total, speed, accel, momentum, force)
        bias[first : first + count] = 0.0
        if with_matrix:
            matrix[first : first + count] = 0.0
        for i in range(k - 1, -1, -1):
            c, g, up = links[i, COORDINATE], frames[i, GAIN], links[i, PARENT]
            _dot(lanes, screw[i], force[i], along)
            for l in range(count):
                body_force[first + l, i] = along[l]
                bias[first + l, c] += g * along[l]
            if with_matrix:
                _momentum(lanes, i, total, screw, momentum)
                _dot(lanes, screw[i], momentum, along)
                for l in range(count):
                    matrix[first + l, c, c] += g * g * along[l]
                above = up
                while above >= 0:
                    _dot(lanes, screw[above], momentum, along)
                    d, both = links[above, COORDINATE], g * frames[above, GAIN]
                    for l in range(count):
                        matrix[first + l, c, d] += both * along[l]
                        matrix[first + l, d, c] += both * along[l]
                    above = links[above, PARENT]
            if up >= 0:
                for r in range(6):
                    for l in range(len(lanes)):
                        force[up, r, l] += force[i, r, l]
                if with_matrix:
                    for r in range(10):
                        for l in range(len(lanes)):
                            total[up, r, l] += total[i, r, l]


def lanes(batch: int) -> tuple[int, ...]:
    """The lanes for a batch of samples."""
    return ONE if batch == 1 else LANES


class RigidBodies:
    """Dynamics of a tree; every call takes a batch (B, n) and mechanics whose leading axis divides B.

    mass (Bm, k), first_moment (Bm, k, 3), inertia (Bm, k, 3, 3), gravity (Bg, arms, 3): sample b uses row b mod Bm.
    """

    def __init__(self, tree: KinematicTree) -> None:
        k = tree.bodies
        self.links = np.column_stack([tree.parent, tree.coordinate, tree.prismatic, tree.arm[tree.coordinate]])
        self.frames = np.column_stack([tree.rotation.reshape(k, 9), tree.origin, tree.axis, tree.gain, tree.offset])
        self._still = np.zeros((0, 0))

    @staticmethod
    def pack(mechanics: Mechanics) -> Masses:
        """Masses in the form of the compiled functions: mass, first moment and inertia (Bm, k, 10), and gravity."""
        mass, moment, inertia = mechanics.mass, mechanics.first_moment, mechanics.inertia
        upper = inertia.reshape(*mass.shape, 9)[..., UPPER]
        return np.concatenate([mass[..., None], moment, upper], axis=-1), mechanics.gravity

    def mass_matrix_and_bias(self, q, v, mechanics: Mechanics | Masses) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix (B, n, n) and bias torque (B, n): gravity, centrifugal and Coriolis; N m."""
        still = self._still  # a local name: threads with other batches may replace the attribute
        if still.shape != q.shape:
            still = self._still = np.zeros_like(q)
        matrix = np.empty((*q.shape, q.shape[1]))
        return matrix, self._run(q, v, still, mechanics, matrix)[0]

    def inverse_dynamics(self, q, v, a, mechanics: Mechanics | Masses) -> tuple[np.ndarray, np.ndarray]:
        """Torque (B, n) that produces the acceleration a, and the torque of each body's joint (B, k)."""
        return self._run(q, v, a, mechanics, NO_MATRIX)

    def _run(self, q, v, a, mechanics: Mechanics | Masses, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        masses = mechanics if isinstance(mechanics, tuple) else self.pack(mechanics)
        torque, force = np.empty(q.shape), np.empty((len(q), len(self.links)))
        run_dynamics(lanes(len(q)), q, v, a, self.links, self.frames, *masses, matrix, torque, force)
        return torque, force
