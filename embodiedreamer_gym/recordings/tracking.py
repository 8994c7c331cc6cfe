"""How well each joint follows its command, and helpers shared by the checks before a fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from embodiedreamer_gym.recordings.recording import Recording

LONGEST_DELAY = 0.15  # s; ordinary servos respond sooner
SMALL = {"rad": 0.02, "m": 0.001, "1": 0.02}  # error that backlash, friction and a dead zone cause on any servo


@dataclass(frozen=True, eq=False)
class Tracking:
    """A recording compared with its delayed command.

    expected (T, n): the command, delayed by the best-fitting time of each joint, at most 150 ms; error (T, n): position
    minus expected; span (n,): range of the command; small (n,): a deviation that is not significant, in units[j].
    """

    expected: np.ndarray
    error: np.ndarray
    span: np.ndarray
    small: np.ndarray


def track(recording: Recording, command: np.ndarray) -> Tracking:
    """Delay each joint's command so that it is closest to the position, apart from an offset."""
    delays = np.unique(np.linspace(0, LONGEST_DELAY, 1 + min(15, max(1, round(LONGEST_DELAY * recording.hz)))))
    expected = np.empty_like(recording.position)
    for j, (x, u) in enumerate(zip(recording.position.T, command.T, strict=True)):
        shifted = [np.interp(recording.time - delay, recording.time, u) for delay in delays]
        costs = [float(np.mean(np.abs(x - s - np.median(x - s)))) for s in shifted]
        expected[:, j] = shifted[int(np.argmin(costs))]
    small = np.array([SMALL[unit] for unit in recording.units])
    return Tracking(
        expected=expected,
        error=recording.position - expected,
        span=np.ptp(command, axis=0),
        small=np.maximum(small, np.maximum(10 * recording.noise, 3 * recording.quantum)),
    )


def samples(recording: Recording, seconds: float) -> int:
    """Number of samples that cover this time, at least 2."""
    return max(2, round(seconds * recording.hz) + 1)


def trailing_range(x: np.ndarray, count: int) -> np.ndarray:
    """Range of the last `count` samples at each sample (T, n); infinite where there are fewer so far."""
    result = np.full(x.shape, np.inf)
    if len(x) >= count:
        last = (count - 1) // 2  # shifts the filter's window to end at the sample
        extremes = (f(x, count, axis=0, origin=last) for f in (maximum_filter1d, minimum_filter1d))
        span = np.subtract(*extremes)
        result[count - 1 :] = span[count - 1 :]
    return result


def runs(mask: np.ndarray) -> Iterator[slice]:
    """Stretches of a mask (T,) that are true throughout."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(stop))


def arms(joints: tuple[str, ...]) -> list[list[int]]:
    """Columns of each arm: joints with the prefix left or right; all others form one group."""
    groups: dict[str, list[int]] = {}
    for column, joint in enumerate(joints):
        prefix = joint.lower().split("_")[0].split("/")[0]
        groups.setdefault(prefix if prefix in ("left", "right") else "", []).append(column)
    return list(groups.values())


def is_gripper(joint: str, unit: str) -> bool:
    """Whether a joint is a gripper: normalised, or named so."""
    return unit == "1" or any(word in joint.lower() for word in ("gripper", "jaw", "finger"))
