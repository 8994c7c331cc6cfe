"""Recordings from ROS 2 bags: positions from a topic of joint states, commands from another topic."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.csv_text import MAX_COLUMNS
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS
from embodiedreamer_gym.recordings.joint_names import find_joints
from embodiedreamer_gym.recordings.recording import FEWEST_SAMPLES, Recording
from embodiedreamer_gym.recordings.rosbag import (
    CONTROLLER,
    JOINT_STATE,
    NUMBERS,
    TRAJECTORY,
    Bag,
    Message,
    chosen_topic,
    open_bag,
)  # fmt: skip
from embodiedreamer_gym.recordings.sage_csv import resample

STATES, COMMANDS = (JOINT_STATE, CONTROLLER), (CONTROLLER, JOINT_STATE, TRAJECTORY, NUMBERS)
USUAL = "joint_states"  # usual end of the state topic's name, preferred where there are several topics
SIGNALS = ("position", "velocity", "effort")
CLOCKS = 1_000_000_000  # ns; a larger difference between stamps and arrival means different clocks


@dataclass
class Track:
    """Data of a topic: stamps and arrival times in ns, and joint values; names: joint names of the first message."""

    topic: str
    names: tuple[str, ...] = ()
    stamps: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)
    values: dict[str, list[np.ndarray | None]] = field(default_factory=lambda: {name: [] for name in SIGNALS})
    trajectories: list[list[tuple[int, np.ndarray]]] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    @property
    def stamped(self) -> bool:
        """Whether each message carries a stamp."""
        return all(self.stamps)

    def array(self, signal: str) -> np.ndarray | None:
        """Values (T, n); None where some messages lack them, or all are zero or not numbers."""
        rows = self.values[signal]
        kept = [row for row in rows if row is not None]
        if len(kept) < len(rows) or not rows:
            return None
        array = np.array(kept, float)
        return array if signal == "position" or (np.isfinite(array).all() and array.any()) else None


def read_rosbag(
    path: str | Path, joints: Sequence[str] | None = None, state_topic: str | None = None, command_topic: str | None = None,
    command_hold: str | None = None,
) -> Recording:  # fmt: skip
    """Read an MCAP file or a rosbag2 as a recording at the times of its states (header stamps if there are any).

    Each state gets the latest command before it, or an interpolated one for command_hold "linear"; trajectories are
    interpolated linearly between their points. States before the first command are left out.
    Raises: RecordingError where a topic is missing or has to be chosen, or messages do not match.
    """
    path = Path(path)
    with open_bag(path) as bag:
        states = [topic for topic, kind in bag.topics.items() if kind in STATES]
        joint_states = [topic for topic in states if bag.topics[topic] == JOINT_STATE]
        usual = [topic for topic in states if topic.rpartition("/")[2] == USUAL]
        options = states if state_topic else usual if len(usual) == 1 else joint_states or states
        topic = chosen_topic(options, state_topic, "--state-topic", "joint states", path)
        state = _track(bag, topic, joints, "actual", path)
        names = state.names if joints is None else tuple(joints)
        command = None
        others = [one for one, kind in bag.topics.items() if kind in COMMANDS and (one != topic or kind == CONTROLLER)]
        if others or command_topic:
            best = [one for one in others if bag.topics[one] == CONTROLLER] or others
            best = others if command_topic else best
            topic = chosen_topic(best, command_topic, "--command-topic", "commands", path)
            command = _track(bag, topic, names, "wanted", path, _start(state))
    return _recording(path, names, state, command, command_hold)


def _start(state: Track) -> np.ndarray | None:
    """The first measured position."""
    position = state.array("position")
    return None if position is None else position[0]


def _track(
    bag: Bag, topic: str, joints: Sequence[str] | None, point: str, path: Path, start: np.ndarray | None = None
) -> Track:
    """Read a topic; point: "wanted" or "actual" point of a controller's state; start: position before a trajectory."""
    kind, track = bag.topics[topic], Track(topic)
    columns: dict[tuple[str, ...], list[int]] = {}
    for message in bag.messages(topic, MAX_NUMBERS // (3 * max(len(joints or ()), 1))):
        data = message.data
        names = tuple(data.name if kind == JOINT_STATE else getattr(data, "joint_names", ()))
        if kind == NUMBERS:
            names = _names_of_numbers(len(data.data), joints, f"{path}: {topic}")
            track.notes = (
                f"the commands of {topic} carry no names; they were taken in the order of the model's joints",
            )
        if names not in columns:
            if len(names) > MAX_COLUMNS or len(columns) > 100:
                raise RecordingError(f"{path}: {topic} names more joints than a robot has")
            columns[names], notes = find_joints(names, names if joints is None else joints, f"{path}, {topic}")
            track.names, track.notes = track.names or names, track.notes or notes
        _add(track, message, kind, point, columns[names], len(names), path, start)
    if not track.stamps:
        raise RecordingError(f"{path}: {topic} has no message")
    return track


def _add(
    track: Track, message: Message, kind: str, point: str, columns: list[int], count: int, path: Path, start: Any
) -> None:
    """Add a message to a track."""
    data = message.data
    stamp = getattr(data, "header", None)
    stamp = 0 if stamp is None else stamp.stamp.sec * 1_000_000_000 + stamp.stamp.nanosec
    track.stamps.append(stamp)
    track.received.append(message.received)
    if kind == TRAJECTORY:
        points = [
            (p.time_from_start.sec * 1_000_000_000 + p.time_from_start.nanosec, _chosen(p.positions, columns, count))
            for p in data.points
        ]
        if not points or any(row is None for _, row in points):
            raise RecordingError(f"{path}: a trajectory of {track.topic} has no points, or no positions")
        track.trajectories.append([(after, row) for after, row in points if row is not None])
        return
    source = data if kind == JOINT_STATE else getattr(data, point, None)
    for signal in SIGNALS:
        name = (
            signal if kind == JOINT_STATE else {"position": "positions", "velocity": "velocities"}.get(signal, signal)
        )
        row = data.data if kind == NUMBERS and signal == "position" else getattr(source, name, ())
        track.values[signal].append(_chosen(row, columns, count))


def _chosen(row: Any, columns: list[int], count: int) -> np.ndarray | None:
    """The chosen columns of a row; None if the row does not have one number for each name."""
    return np.asarray(row, float)[columns] if len(row) == count else None


def _names_of_numbers(count: int, joints: Sequence[str] | None, what: str) -> tuple[str, ...]:
    if joints is None or count != len(joints):
        raise RecordingError(
            f"{what} has {count} numbers without names for the joints {', '.join(joints or ()) or 'of the states'}"
        )
    return tuple(joints)


def _recording(path: Path, names: tuple[str, ...], state: Track, command: Track | None, hold: str | None) -> Recording:
    """Put states and commands on one time axis."""
    position = state.array("position")
    if position is None:
        raise RecordingError(
            f"{path}: in some messages of {state.topic} the number of positions differs from the number of names"
        )
    stamps, notes = _times(state, command)
    order = np.argsort(stamps[0], kind="stable")
    order = order[np.diff(stamps[0][order], prepend=stamps[0].min() - 1) > 0]
    if len(order) < len(position):
        notes += (f"{len(position) - len(order)} messages of {state.topic} repeat a stamp and were left out",)
    time, commanded = stamps[0][order], None
    if command is not None:
        where, commanded, linear = _command(path, command, stamps[1], position[0], hold)
        late = int(np.searchsorted(time, where[0]))
        if len(time) - late < FEWEST_SAMPLES:
            raise RecordingError(
                f"{path}: {state.topic} and {command.topic} do not overlap in time; they must use the same clock"
            )
        notes += (f"{late} states before the first command were left out",) if late else ()
        order, time = order[late:], time[late:]
        commanded = resample((where - time[0]) / 1e9, commanded, (time - time[0]) / 1e9, linear or hold == "linear")
        hold = hold or ("linear" if linear else None)
    more: dict[str, Any] = {signal: None if (x := state.array(signal)) is None else x[order] for signal in SIGNALS[1:]}
    return Recording(
        name=path.stem, joints=names, time=(time - time[0]) / 1e9, position=position[order], command=commanded,
        command_hold=hold or "unknown", source=str(path), notes=tuple(dict.fromkeys((*state.notes, *notes, *(command.notes if command else ())))),
        **more,
    )  # fmt: skip


def _times(state: Track, command: Track | None) -> tuple[list[np.ndarray], tuple[str, ...]]:
    """Times of both topics in ns (header stamps if there are any, else times of arrival), and notes."""
    tracks = [state] if command is None else [state, command]
    unstamped = [one.topic for one in tracks if not one.stamped]
    apart = int(np.median(np.subtract(state.received, state.stamps))) if state.stamped else 0
    arrival = [not one.stamped for one in tracks]
    notes = tuple(f"the messages of {topic} carry no stamps; their times are arrival times" for topic in unstamped)
    if len(tracks) == 2 and any(arrival) and not all(arrival) and abs(apart) > CLOCKS:
        arrival = [True, True]
        notes += (
            f"the stamps of {state.topic} come from a different clock than the arrival times; arrival times are "
            "used for both topics",
        )
    return [
        np.array(one.received if late else one.stamps, np.int64) for one, late in zip(tracks, arrival, strict=True)
    ], notes


def _command(
    path: Path, track: Track, stamps: np.ndarray, start: np.ndarray, hold: str | None
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Times (K,) ns and commands (K, n), and whether they are to be interpolated."""
    if track.trajectories:
        return (*_knots(track.trajectories, stamps, start), True)
    values = track.array("position")
    if values is None:
        raise RecordingError(
            f"{path}: in some messages of {track.topic} the number of positions differs from the number of names"
        )
    order = np.argsort(stamps, kind="stable")
    order = order[np.diff(stamps[order], prepend=stamps.min() - 1) > 0]
    return stamps[order], values[order], hold == "linear"


def _knots(
    trajectories: Iterable[list[tuple[int, np.ndarray]]], stamps: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corner points of the path that trajectories command; each trajectory replaces the rest of the previous one.

    A point at the start time of its trajectory is reached by a jump, 1 ns later.
    """
    times: list[int] = [int(stamps.min())]
    rows: list[np.ndarray] = [np.asarray(start, float)]
    for begin, points in sorted(zip(stamps.tolist(), trajectories, strict=True), key=lambda one: one[0]):
        kept, now = bisect_left(times, begin), rows[-1]
        if 0 < kept < len(times):
            share = (begin - times[kept - 1]) / (times[kept] - times[kept - 1])
            now = rows[kept - 1] + share * (rows[kept] - rows[kept - 1])
        del times[kept:], rows[kept:]
        times.append(begin)
        rows.append(now)
        for after, row in points:
            at = max(begin + after, times[-1] + 1)
            times.append(at)
            rows.append(row)
    return np.array(times, np.int64), np.array(rows)
