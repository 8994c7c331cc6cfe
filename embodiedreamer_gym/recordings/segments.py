"""Segments of long recordings: a fit needs minutes of varied motion, not hours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from embodiedreamer_gym.recordings.recording import Recording, Recordings

SHORTEST = 4.0  # s
LONGEST = 12.0  # s
FEWEST = 16  # fewest samples of a piece
EFFORT_HZ = 100.0  # rate of logs without commands, whose efforts are smoothed over 0.12 s and then compared
BURN_IN = 0.5  # s at a window's start that are simulated but not compared, as the motion before is unknown


def window(recording: Recording, start: float, end: float) -> Recording:
    """The part of a recording from `start` to `end` seconds after its first sample.

    The first half second counts as not usable, unless the window starts where the recording does.
    """
    elapsed = recording.time - recording.time[0]
    rows = (elapsed >= start - 1e-9) & (elapsed <= end + 1e-9)
    usable = recording.usable[rows].copy()
    if start > 0:
        usable[elapsed[rows] < start + BURN_IN] = False
    name = f"{recording.name} {start:.0f}-{end:.0f} s"
    return recording.with_(**_signals(recording, lambda signal: signal[rows]), usable=usable, frames={}, name=name)


def pieces(recordings: Sequence[Recording], seconds: float) -> Recordings:
    """Recordings cut into consecutive pieces of about `seconds`, of at least 16 samples each; all samples stay usable."""
    result: list[Recording] = []
    for recording in recordings:
        count = max(1, int(min(recording.duration / seconds, recording.time.size / FEWEST)))
        for rows in np.array_split(np.arange(recording.time.size), count):
            result.append(recording.with_(
                **_signals(recording, lambda signal, rows=rows: signal[rows]), usable=recording.usable[rows],
                frames={}, name=f"{recording.name} from {recording.time[rows[0]]:.2f} s",
            ))  # fmt: skip
    return Recordings(result)


def thin(recordings: Sequence[Recording], seconds: float) -> Recordings:
    """Reduce recordings to about `seconds` in total, if they are longer: keep the windows with the most motion.

    Windows are 4 to 12 s long; if there are too many recordings for 4 s each, every second, third, ... is taken.
    Recordings without a command are averaged to 100 Hz.
    """
    recordings = [averaged(r, EFFORT_HZ) if r.command is None else r for r in recordings]
    if sum(r.duration for r in recordings) <= 1.2 * seconds:
        return Recordings(recordings)
    step = int(np.ceil(len(recordings) * SHORTEST / seconds))
    kept = recordings[::step]
    share = seconds / len(kept)
    result: list[Recording] = []
    for recording in kept:
        count = max(1, int(share // LONGEST))
        length = min(share / count, LONGEST)
        result += _most_active(recording, length, count) if recording.duration > 1.5 * length else [recording]
    return Recordings(result)


def averaged(recording: Recording, hz: float) -> Recording:
    """Reduce a recording to about `hz` by means of consecutive samples; below 1.5 times `hz` it stays unchanged.

    A mean is usable where all of its samples are.
    """
    count = int(recording.hz / hz + 0.5)
    if count < 2 or recording.time.size < FEWEST * count:
        return recording
    rows = recording.time.size // count * count

    def mean(signal: np.ndarray) -> np.ndarray:
        return signal[:rows].reshape(-1, count, *signal.shape[1:]).mean(axis=1)

    return recording.with_(
        **_signals(recording, mean), usable=mean(recording.usable) == 1.0,
        noise=recording.noise / np.sqrt(count), quantum=recording.quantum / np.sqrt(count), frames={},
    )  # fmt: skip


def _signals(recording: Recording, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Time and signals of a recording, all changed alike; None stays None."""
    held = {name: getattr(recording, name) for name in ("time", "position", "command", "velocity", "effort")}
    return {name: None if signal is None else change(signal) for name, signal in held.items()}


def _most_active(recording: Recording, length: float, count: int) -> list[Recording]:
    """The `count` windows in which the joints move most, relative to each joint's own motion in the recording."""
    spread = recording.position.std(axis=0)
    moving = spread > 5 * recording.sigma
    starts = np.arange(0.0, recording.duration - length + 1e-9, length / 2)
    elapsed = recording.time - recording.time[0]
    activity = []
    for start in starts:
        rows = (elapsed >= start) & (elapsed <= start + length)
        part = recording.position[rows].std(axis=0)[moving] / spread[moving]
        activity.append(float(np.sum(np.log1p(part))) if rows.sum() > 10 and recording.usable[rows].any() else -1.0)
    chosen: list[float] = []
    for k in np.argsort(activity, kind="stable")[::-1]:
        if all(abs(starts[k] - other) >= length - 1e-9 for other in chosen):
            chosen.append(float(starts[k]))
        if len(chosen) == count:
            break
    return [window(recording, start, start + length) for start in sorted(chosen)]
