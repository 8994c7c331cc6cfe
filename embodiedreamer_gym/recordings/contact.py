"""Contact of an arm with its surroundings: samples that a fit of the free arm must not use.

The two rules do not find every contact; they are made to avoid false alarms on ordinary lag, delay, friction and
gravity sag:

* held: a gripper is commanded to close further (to smaller values) but stands still, well short of the command, for
  0.3 s or longer. A gripper of unit "1" below 0.05, or at its lower limit, counts as closed and empty. Without limits,
  an empty gripper in rad commanded past its end stop counts as held: this excludes samples but causes no error.
* pushed: no joint of the arm has been commanded to move for 0.5 s, all joints stood still for 0.3 s, and then one
  moves by 40 mrad or more within 0.2 s: an external force. A push during a motion is not detected.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.tracking import Tracking, arms, is_gripper, runs, samples, trailing_range

HELD_FOR = 0.3  # s; longer than the delay and rise time of any free gripper
STANDING, SETTLED, SUDDEN = 0.5, 0.3, 0.2  # s
CLOSED = 0.05  # position of a normalised gripper below which it is closed


def held(recording: Recording, tracking: Tracking, limits: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Samples (T, n) at which a gripper holds something, in the gripper's own column."""
    contact = np.zeros(recording.position.shape, dtype=bool)
    still = trailing_range(recording.position, samples(recording, SUDDEN))
    for j, joint in enumerate(recording.joints):
        if not is_gripper(joint, recording.units[j]):
            continue
        x, error = recording.position[:, j], tracking.error[:, j]
        short = max(0.1 * tracking.span[j], 2.5 * tracking.small[j]) + float(np.percentile(np.abs(error), 10))
        low = limits.get(joint, (CLOSED - tracking.small[j] if recording.units[j] == "1" else -np.inf, np.inf))[0]
        mask = (error > short) & (still[:, j] < 0.5 * tracking.small[j]) & (x > low + tracking.small[j])
        for run in runs(mask):
            if recording.time[run.stop - 1] - recording.time[run.start] >= HELD_FOR - SUDDEN:
                contact[max(0, run.start - samples(recording, SUDDEN)) : run.stop, j] = True
    return contact


def pushed(recording: Recording, tracking: Tracking, command: np.ndarray) -> np.ndarray:
    """Samples (T, n) at which a joint was moved from outside while its whole arm was commanded to stand still."""
    x, back = recording.position, samples(recording, SUDDEN) - 1
    contact = np.zeros(x.shape, dtype=bool)
    standing = trailing_range(command, samples(recording, STANDING + SUDDEN)) < 0.25 * tracking.small
    settled = trailing_range(x, samples(recording, SETTLED)) < 0.5 * tracking.small
    for arm in arms(recording.joints):
        calm = np.asarray(standing[:, arm].all(axis=1))
        before = np.roll(settled[:, arm].all(axis=1), back)
        before[:back] = False
        for j in arm:
            moved = np.abs(x[:, j] - np.roll(x[:, j], back)) > 2 * tracking.small[j]
            for stretch in runs(calm):
                starts = np.flatnonzero((moved & before)[stretch]) + stretch.start
                if starts.size:
                    rest = x[starts[0] - back, j]
                    away = np.abs(x[starts[0] : stretch.stop, j] - rest) > tracking.small[j]
                    last = starts[0] + int(np.flatnonzero(away)[-1]) + 1 if away.any() else starts[0] + 1
                    contact[starts[0] - back : last, j] = True
    return contact


def whole_arm(recording: Recording, mask: np.ndarray, margin: float = 0.2) -> np.ndarray:
    """The mask (T, n) extended to every joint of the same arm, and by a margin in s on both sides."""
    result = np.zeros(mask.shape, dtype=bool)
    for arm in arms(recording.joints):
        result[:, arm] = widened(recording, np.asarray(mask[:, arm].any(axis=1)), margin)[:, None]
    return result


def widened(recording: Recording, mask: np.ndarray, margin: float = 0.2) -> np.ndarray:
    """The mask (T,) with each stretch extended by a margin in s on both sides."""
    result = mask.copy()
    for run in runs(mask):
        first, last = recording.time[run.start] - margin, recording.time[run.stop - 1] + margin
        result |= (recording.time >= first) & (recording.time <= last)
    return result
