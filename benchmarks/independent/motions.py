"""Commanded motions as functions of time (s) -> (n,) rad: sines, point-to-point moves, ramps, teleoperation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.independent.arms import Arm

Path = Callable[[np.ndarray], np.ndarray]  # times (T,) -> angles (T, n)


def sines(arm: Arm, rng: np.random.Generator, seconds: float) -> Path:
    """Five sines per joint from 0.15 to 2.5 Hz with random phases, faded in over one second."""
    n = len(arm.joints)
    hertz = np.exp(rng.uniform(np.log(0.15), np.log(2.5), (5, n)))
    size = 1 / (1 + 2.5 * hertz) * rng.uniform(0.5, 1.0, (5, n))
    size *= 0.8 * arm.each("reach") / size.sum(axis=0)
    phase = rng.uniform(0, 2 * np.pi, (5, n))

    def path(time: np.ndarray) -> np.ndarray:
        fade = _minimum_jerk(np.asarray(time)[:, None] / 1.0)
        waves = size * np.sin(2 * np.pi * hertz * np.asarray(time)[:, None, None] + phase)
        return arm.each("home") + fade * waves.sum(axis=1)

    return path


def point_to_point(arm: Arm, rng: np.random.Generator, seconds: float) -> Path:
    """Minimum-jerk moves of 0.4 to 1.1 s of all joints together, with pauses of 0.2 to 0.6 s in between."""
    starts, durations, goals = [0.3], [rng.uniform(0.4, 1.1)], [_pose(arm, rng)]
    while starts[-1] + durations[-1] < seconds:
        starts.append(starts[-1] + durations[-1] + rng.uniform(0.2, 0.6))
        durations.append(rng.uniform(0.4, 1.1))
        goals.append(_pose(arm, rng))
    n = len(arm.joints)
    return _moves(
        _pose(arm, rng), [[(s, d, g[j]) for s, d, g in zip(starts, durations, goals, strict=True)] for j in range(n)]
    )


def ramps(arm: Arm, rng: np.random.Generator, seconds: float) -> Path:
    """Ramps of 0.1 to 1.2 rad/s with holds of 0.2 to 0.8 s, each joint at its own times."""
    columns = []
    for joint in arm.joints:
        time, angle = [0.0, rng.uniform(0.1, 0.5)], [joint.home + joint.reach * rng.uniform(-0.8, 0.8)] * 2
        while time[-1] < seconds:
            goal = joint.home + joint.reach * rng.uniform(-0.9, 0.9)
            speed = np.exp(rng.uniform(np.log(0.1), np.log(1.2)))
            time += [time[-1] + max(abs(goal - angle[-1]) / speed, 0.05)]
            time += [time[-1] + rng.uniform(0.2, 0.8)]
            angle += [goal, goal]
        columns.append((np.array(time), np.array(angle)))
    return lambda t: np.stack([np.interp(t, time, angle) for time, angle in columns], axis=1)


def teleoperation(arm: Arm, rng: np.random.Generator, seconds: float) -> Path:
    """A person reaches, waits and corrects: joints start at different times, some rest; the leader arm has 12 bits."""
    n = len(arm.joints)
    moves: list[list[tuple[float, float, float]]] = [[] for _ in range(n)]
    begin = rng.uniform(0.2, 0.5)
    now = _pose(arm, rng)
    first = now.copy()
    while begin < seconds:
        duration = rng.uniform(0.5, 1.6)
        goal = np.where(rng.random(n) < 0.75, _pose(arm, rng), now)
        for j in range(n):
            moves[j].append((begin + rng.uniform(0, 0.15), duration * rng.uniform(0.7, 1.0), goal[j]))
            near = goal[j] + rng.normal(0, 0.02) * (goal[j] != now[j])
            moves[j].append((begin + duration + 0.16, rng.uniform(0.25, 0.4), near))  # a correction at the end
            goal[j] = near
        now = goal
        begin += duration + 0.6 + rng.uniform(0.0, 0.7)
    reach = _moves(first, moves)
    step = 2 * np.pi / 4096
    return lambda t: np.round(reach(t) / step) * step


KINDS: dict[str, Callable[[Arm, np.random.Generator, float], Path]] = {
    "sines": sines, "point_to_point": point_to_point, "ramps": ramps, "teleoperation": teleoperation,
}  # fmt: skip


def _pose(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    return arm.each("home") + arm.each("reach") * rng.uniform(-0.9, 0.9, len(arm.joints))


def _moves(first: np.ndarray, moves: Sequence[Sequence[tuple[float, float, float]]]) -> Path:
    """Consecutive minimum-jerk moves; moves: for each joint (start s, duration s, goal rad), without overlap."""

    def path(time: np.ndarray) -> np.ndarray:
        columns = []
        for begin, row in zip(first, moves, strict=True):
            angle, now = np.full(np.shape(time), begin), begin
            for start, duration, goal in row:
                angle = angle + (goal - now) * _minimum_jerk((np.asarray(time) - start) / duration)
                now = goal
            columns.append(angle)
        return np.stack(columns, axis=1)

    return path


def _minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Rise from 0 to 1 with zero speed and acceleration at both ends (Flash and Hogan 1985)."""
    s = np.clip(share, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)
