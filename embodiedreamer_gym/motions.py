"""Commanded motions, continuous in time, that excite a robot's dynamics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """A commanded motion: `motion(t)` is (n,) for one time and (k, n) for times (k,) s; constant outside 0 .. duration.

    at_rest: whether it begins and ends at rest at the centre of its span.
    """

    command: Callable[[Array], Array]
    duration: float
    kind: str
    at_rest: bool = False

    def __call__(self, t: float | Array) -> Array:
        """Commanded position at one or several times."""
        times = np.clip(np.atleast_1d(np.asarray(t, float)), 0.0, self.duration)
        values = self.command(times)
        return values if np.ndim(t) else values[0]


@dataclass(frozen=True, eq=False)
class Span:
    """Range of the commands: centre (n,), reach (n,) on either side, highest speed (n,) per s, highest acceleration.

    The acceleration, per s^2, limits only reversals, bang_bang and chirp.
    """

    centre: Array
    reach: Array
    speed: Array
    acceleration: float = 6.0


def multisine(
    span: Span, rng: np.random.Generator, duration: float = 4.0, lowest: float = 0.2, highest: float = 2.5
) -> Motion:
    """Eight sines per joint with random frequency [Hz] and phase; slower ones are larger, and the ends are ramped."""
    n = len(span.centre)
    frequency = np.sort(rng.uniform(lowest, highest, (n, 8)), axis=1)
    phase, amplitude = rng.uniform(0, 2 * np.pi, (n, 8)), 1.0 / frequency
    edge = min(0.5, duration / 4)

    def wave(t: Array) -> Array:
        window = _min_jerk(np.minimum(t, duration - t) / edge)
        total = np.zeros((len(t), n))
        for k in range(frequency.shape[1]):
            total += amplitude[:, k] * np.sin(2 * np.pi * t[:, None] * frequency[:, k] + phase[:, k])
        return window[:, None] * total

    grid = np.arange(0, duration, 1e-3)
    values = wave(grid)
    peak, fastest = np.abs(values).max(0), np.abs(np.gradient(values, 1e-3, axis=0)).max(0)
    scale = np.minimum(span.reach / peak, span.speed / fastest)
    return Motion(lambda t: span.centre + scale * wave(t), duration, "multisine")


def point_to_point(span: Span, rng: np.random.Generator, duration: float = 4.0, pace: float = 1.0) -> Motion:
    """Fast minimum-jerk moves between random poses with short stops; `pace` is a share of the highest speed."""
    times, points = [0.0, 0.1], [span.centre, span.centre]
    while times[-1] < duration:
        target = span.centre + span.reach * rng.uniform(-1, 1, len(span.centre))
        _travel(times, points, target, span.speed * pace)
        _pause(times, points, rng.uniform(0.05, 0.25))
    return Motion(_path(times, points, _min_jerk), duration, "point_to_point")


def slow_ramps(span: Span, rng: np.random.Generator, duration: float = 4.0, pace: float = 0.06) -> Motion:
    """Every joint moves back and forth at its own slow constant speed, about `pace` times the highest speed."""
    speed = span.speed * pace * rng.uniform(0.6, 1.4, len(span.centre))
    turn = np.minimum(span.reach, speed * duration * rng.uniform(0.15, 0.3, len(span.centre)))
    middle = span.centre + (span.reach - turn) * rng.uniform(-1, 1, len(span.centre))
    sign = rng.choice([-1.0, 1.0], len(span.centre))

    def sweep(t: Array) -> Array:
        phase = t[:, None] * speed / (4 * turn)
        return middle + sign * turn * (1 - 4 * np.abs((phase + 0.25) % 1.0 - 0.5))

    return Motion(sweep, duration, "slow_ramps")


def teleoperation(span: Span, rng: np.random.Generator, duration: float = 4.0, pace: float = 0.35) -> Motion:
    """Motion like human teleoperation: waypoints reached with some of the joints, pauses, and small corrections."""
    n = len(span.centre)
    times, points = [0.0, 0.2], [span.centre, span.centre]
    while times[-1] < duration:
        moved = rng.random(n) < 0.7
        if rng.random() < 0.4:  # a correction
            target = points[-1] + moved * span.reach * rng.normal(0, 0.05, n)
        else:
            goal = span.centre + span.reach * rng.uniform(-0.9, 0.9, n)
            target = np.where(moved, goal, points[-1])
        target = np.clip(target, span.centre - span.reach, span.centre + span.reach)
        _travel(times, points, target, span.speed * pace * rng.uniform(0.5, 1.5))
        if rng.random() < 0.4:
            _pause(times, points, rng.uniform(0.1, 0.5))
    return Motion(_path(times, points, _min_jerk), duration, "teleoperation")


def hold_poses(span: Span, rng: np.random.Generator, duration: float = 6.0, hold: float = 1.2) -> Motion:
    """Random poses, each held for a while."""
    times, points = [0.0, 0.5], [span.centre, span.centre]
    while times[-1] < duration:
        _travel(times, points, span.centre + span.reach * rng.uniform(-1, 1, len(span.centre)), span.speed * 0.5)
        _pause(times, points, hold)
    return Motion(_path(times, points, _min_jerk), duration, "hold_poses")


def staircase(span: Span, rng: np.random.Generator, duration: float = 6.0, hold: float = 0.6) -> Motion:
    """Sudden steps of a tenth to half of the reach, up and down."""
    times, points = [0.0, hold], [span.centre, span.centre]
    while times[-1] < duration:
        step = span.reach * rng.uniform(0.1, 0.5, len(span.centre)) * rng.choice([-1, 1], len(span.centre))
        points.append(np.clip(points[-1] + step, span.centre - span.reach, span.centre + span.reach))
        times.append(times[-1] + hold)
    return Motion(_path(times, points, lambda s: (s >= 1).astype(float)), duration, "staircase")


def reversals(span: Span, rng: np.random.Generator, duration: float = 8.0, sizes: int = 8) -> Motion:
    """Every joint moves back and forth about the centre without pauses, by up to half its reach, in random order."""
    goals = []
    for reach, speed in zip(span.reach, span.speed, strict=True):
        largest = reach / 2
        while True:  # reduce until there is time for every amplitude, back and forth
            amplitudes = largest * np.geomspace(SMALLEST, 1.0, sizes)
            moves = np.array([_quickest_time(2 * a, speed, span.acceleration) for a in amplitudes])
            cycles = int(0.9 * duration / (2 * moves.sum()))
            if cycles:
                break
            largest *= 0.8
        order = rng.permutation(sizes)
        signs = np.tile([1.0, -1.0], cycles) * rng.choice([-1.0, 1.0])
        goals.append(np.outer(amplitudes[order], signs).ravel())
    return Motion(_quickest(span, goals, duration), duration, "reversals", at_rest=True)


def bang_bang(span: Span, rng: np.random.Generator, duration: float = 8.0) -> Motion:
    """Every joint makes random moves at full acceleration, then full deceleration, up to the highest speed."""
    goals = []
    for reach in span.reach:
        own, place = [], 0.0
        for half in rng.uniform(*HALF_MOVE, int(duration / (2 * HALF_MOVE[0])) + 1):
            step = min(span.acceleration * half**2, 0.9 * reach) * rng.choice([-1.0, 1.0])
            place += step if abs(place + step) <= reach else -step
            own.append(place)
        goals.append(np.array(own))
    return Motion(_quickest(span, goals, duration), duration, "bang_bang", at_rest=True)


def chirp(
    span: Span, rng: np.random.Generator, duration: float = 8.0, lowest: float = 0.3, highest: float = 6.0
) -> Motion:
    """One sine per joint with rising frequency [Hz], as large as reach, speed and acceleration allow."""
    n = len(span.centre)
    rate = np.log(highest * rng.uniform(0.7, 1.0, n) / lowest) / duration  # rate of the log frequency, per s
    sign, edge = rng.choice([-1.0, 1.0], n), duration / 5

    def wave(t: Array) -> Array:
        omega = 2 * np.pi * lowest * np.exp(t[:, None] * rate)
        limits = np.stack(np.broadcast_arrays(span.reach, span.speed / omega, span.acceleration / omega**2))
        size = np.sum(limits**-4.0, axis=0) ** -0.25  # a smooth minimum
        window = _min_jerk(np.minimum(t, duration - t) / edge)[:, None]
        return size * window * sign * np.sin((omega - 2 * np.pi * lowest) / rate)

    grid = np.arange(0, duration, 1e-3)
    speeds = np.gradient(wave(grid), 1e-3, axis=0)
    fastest, hardest = np.abs(speeds).max(0), np.abs(np.gradient(speeds, 1e-3, axis=0)).max(0)
    scale = np.minimum(1.0, np.minimum(span.speed / fastest, span.acceleration / hardest))
    return Motion(lambda t: span.centre + scale * wave(t), duration, "chirp", at_rest=True)


MOTIONS = {
    f.__name__: f
    for f in (multisine, point_to_point, slow_ramps, teleoperation, hold_poses, staircase, reversals, bang_bang, chirp)
}
SMALLEST = 0.04  # smallest amplitude of reversals, relative to the largest
HALF_MOVE = (0.08, 0.45)  # s; time of speeding up or slowing down in bang_bang


def _min_jerk(s: Array) -> Array:
    """Minimum-jerk rise from 0 to 1: speed and acceleration are zero at both ends, and the peak speed is 1.875."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _travel(times: list, points: list, target: Array, speed: Array) -> None:
    """Append a minimum-jerk move of at least 0.1 s in which the limiting joint just reaches its speed."""
    needed = float(np.max(1.875 * np.abs(target - points[-1]) / speed))
    times.append(times[-1] + max(needed, 0.1))
    points.append(target)


def _pause(times: list, points: list, seconds: float) -> None:
    times.append(times[-1] + seconds)
    points.append(points[-1])


def _path(times: list, points: list, shape: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Path through points (s, n) at times (s,); `shape` maps the time of a segment (0 to 1) to its progress."""
    at, through = np.array(times), np.array(points)

    def follow(t: Array) -> Array:
        i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
        progress = shape((t - at[i]) / (at[i + 1] - at[i]))[:, None]
        return through[i] + progress * (through[i + 1] - through[i])

    return follow


def _quickest_time(distance: float, speed: float, acceleration: float) -> float:
    """Shortest time of a move from rest to rest, s."""
    if distance < speed**2 / acceleration:
        return 2 * float(np.sqrt(distance / acceleration))
    return distance / speed + speed / acceleration


def _quickest(span: Span, goals: Sequence[Array], duration: float) -> Callable[[Array], Array]:
    """Every joint visits its goals (relative to the centre) as fast as allowed and returns to the centre in time."""
    tracks = [_track(*row, span.acceleration, duration) for row in zip(goals, span.speed, strict=True)]

    def follow(t: Array) -> Array:
        columns = []
        for times, place, speed, acceleration in tracks:
            i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 1)
            since = t - times[i]
            columns.append(place[i] + since * (speed[i] + 0.5 * acceleration[i] * since))
        return span.centre + np.stack(columns, axis=1)

    return follow


def _track(goals: Array, speed: float, acceleration: float, duration: float) -> tuple[Array, Array, Array, Array]:
    """Pieces of constant acceleration from goal to goal: start times (s,), and position, speed, acceleration there."""
    pieces, time, here = [], 0.0, 0.0
    for goal in [*goals, 0.0]:
        needed = _quickest_time(abs(goal - here), speed, acceleration)
        if time + needed + _quickest_time(abs(goal), speed, acceleration) > duration and goal != 0.0:
            continue
        sign, distance = np.sign(goal - here), abs(goal - here)
        rise = min(np.sqrt(distance / acceleration), speed / acceleration)
        top, cruise = acceleration * rise, needed - 2 * rise
        ramp = 0.5 * acceleration * rise**2
        pieces += [
            (time, here, 0.0, sign * acceleration),
            (time + rise, here + sign * ramp, sign * top, 0.0),
            (time + rise + cruise, goal - sign * ramp, sign * top, -sign * acceleration),
        ]
        time, here = time + needed, goal
    times, *state = np.array([*pieces, (time, 0.0, 0.0, 0.0)]).T
    return times, *state
