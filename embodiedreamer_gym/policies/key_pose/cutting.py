"""Key instants of an episode: changes of the gripper, and slow points of the arm between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads its submodules when they are first used

Array = np.ndarray
SMOOTHED = 0.17  # s, over which speeds are averaged
PROMINENT = 0.15  # of the highest speed: least depth of a minimum below the speeds before and after it
SLOW = 0.15  # of the highest speed: the arm rests below it
OPENING = 0.2  # of the gripper's stroke: least range that counts as a change


@dataclass(frozen=True)
class KeyInstant:
    """A key instant of an episode.

    step: at which the arm is at the key pose; arrival, departure: first and last step of its rest there, both equal to
    step if it does not stop; event: whether the gripper changes there; opening: of the gripper from there on.
    """

    step: int
    arrival: int
    departure: int
    event: bool
    opening: float


def gripper_changes(opening: Array) -> Array:
    """Steps at which a gripper's command (T,) crosses the middle of its range; none if it hardly moves."""
    low, high = float(opening.min()), float(opening.max())
    if high - low < OPENING:
        return np.zeros(0, int)
    closed = opening < 0.5 * (low + high)
    return np.flatnonzero(closed[1:] != closed[:-1]) + 1


def cut(angles: Array, opening: Array, hz: float) -> list[KeyInstant]:
    """Key instants of an arm's angles (T, m) and its gripper's command (T,): changes, speed minima, and the end."""
    speed = np.abs(np.diff(angles, axis=0, prepend=angles[:1])).max(axis=1) * hz
    speed = scipy.ndimage.uniform_filter1d(speed, max(1, round(SMOOTHED * hz)))
    slow, last = speed < SLOW * speed.max(), len(speed) - 1
    changes = gripper_changes(opening)
    rests = {int(t) - 1: _rest(slow, int(t) - 1) for t in changes} | {last: _rest(slow, last)}
    begun = _rest(slow, 0)[1]
    taken = [(0, begun), *rests.values()]
    minima = scipy.signal.find_peaks(-speed, prominence=PROMINENT * speed.max())[0]
    passed = [int(t) for t in minima if all(not first <= t <= end for first, end in taken)]
    keys = [
        KeyInstant(t, *rests.get(t, (t, t)), t + 1 in changes, float(opening[min(t + 1, last)]))
        for t in sorted({*rests, *passed})
    ]
    return keys


def _rest(slow: Array, step: int) -> tuple[int, int]:
    """First and last step of the rest around a step."""
    first = end = step
    while first > 0 and slow[first - 1]:
        first -= 1
    while end < len(slow) - 1 and slow[end + 1]:
        end += 1
    return first, end
