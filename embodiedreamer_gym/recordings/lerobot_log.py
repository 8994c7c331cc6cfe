"""Episodes of a LeRobot set as recordings: `observation.state` is the position, `action` the command.

The names of a feature's numbers may end with the signal, as LeRobot's robots write them: `elbow.pos`, `elbow.vel`,
`elbow.torque`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.aloha_hdf5 import default_joints
from embodiedreamer_gym.recordings.episodes.episode_set import ACTION, STATE
from embodiedreamer_gym.recordings.episodes.lerobot import LeRobotEpisode, LeRobotEpisodes
from embodiedreamer_gym.recordings.episodes.lerobot_info import OPTIONAL, Info
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS
from embodiedreamer_gym.recordings.joint_names import find_joints
from embodiedreamer_gym.recordings.motor_units import MotorUnits
from embodiedreamer_gym.recordings.recording import Recording

ENDS = {"pos": "position", "position": "position", "vel": "velocity", "velocity": "velocity", "torque": "effort",
        "effort": "effort"}  # fmt: skip
NEXT = 1e-4  # of the span: an action that is really a later state differs by less, a command by more
CLOSE = 0.95  # share of the steps that must agree; the last steps are often repeated
MOVES = 1e-3  # of the largest span: a joint that moves less is ignored


def read_lerobot_set(
    folder: str | Path, numbers: Sequence[int] | None = None, joints: Sequence[str] | None = None,
    units: MotorUnits | None = None, command_hold: str = "unknown",
) -> Iterator[Recording]:  # fmt: skip
    """Read the episodes of a LeRobot set, v2.0 to v3, as recordings; videos are not read.

    numbers: episodes to read, default: all; joints: joints to take, default: all; units: units of the set's values.
    Raises: RecordingError where the set cannot be used, the units are not known, an episode does not exist, or the actions
    are states instead of commands; MissingExtraError without pyarrow.
    """
    episodes = LeRobotEpisodes(folder, videos=False)
    numbers = range(len(episodes)) if numbers is None else numbers
    bad = [number for number in numbers if number >= len(episodes)]
    if bad:
        raise RecordingError(f"{folder}: there is no episode {bad[0]}; it has 0 to {len(episodes) - 1}")
    size = sum(episodes.lengths[k] for k in numbers) * sum(episodes.info.widths.values())
    if size > MAX_NUMBERS:
        raise RecordingError(f"{folder}: these episodes have {size} numbers; at most {MAX_NUMBERS} are read, choose some with {folder}:0-9")  # fmt: skip
    columns = _Columns(episodes.info, joints, str(folder))
    for number in numbers:
        yield _recording(folder, number, episodes, columns, units or MotorUnits(), command_hold)


class _Columns:
    """Columns of the position, velocity, effort and command of each joint."""

    def __init__(self, info: Info, joints: Sequence[str] | None, source: str) -> None:
        signals = _signals(info, STATE, joints)
        have = tuple(name for name, signal in signals if signal == "position")
        places = {one: k for k, one in enumerate(signals)}
        action = [name for name, signal in _signals(info, ACTION, joints) if signal == "position"]
        in_action = {one: k for k, one in enumerate(_signals(info, ACTION, joints))}
        self.joints = have if joints is None else tuple(joints)
        chosen, self.notes = find_joints(have, self.joints, source)
        names = [have[k] for k in chosen]
        self.action: list[int] = [in_action[action[k], "position"] for k in find_joints(action, names, f"{source}, its actions")[0]]  # fmt: skip
        self.state = [places[name, "position"] for name in names]
        self.more: dict[str, tuple[str, list[int]]] = {}
        for signal, key in OPTIONAL.items():
            if all((name, signal) in places for name in names):
                self.more[signal] = (STATE, [places[name, signal] for name in names])
            elif info.widths.get(key) == len(have):
                self.more[signal] = (key, chosen)


def _signals(info: Info, key: str, joints: Sequence[str] | None) -> list[tuple[str, str]]:
    """Joint and signal of each number of a feature."""
    width = info.widths[key]
    names = info.names[key] or (tuple(joints) if joints is not None and len(joints) == width else default_joints(width))
    split = [(name.rpartition(".")[0] or name, ENDS.get(name.rpartition(".")[2].lower(), "")) for name in names]
    if not any(signal == "position" for _, signal in split):
        return [(name, "position") for name in names]
    return [(joint, signal) if signal else (name, "other") for name, (joint, signal) in zip(names, split, strict=True)]


def _recording(
    folder: str | Path, number: int, episodes: LeRobotEpisodes, columns: _Columns, units: MotorUnits, command_hold: str
) -> Recording:
    episode, info = episodes.episodes[number], episodes.info
    if not isinstance(episode, LeRobotEpisode):
        raise RecordingError(f"{folder}: episode {number} is not a LeRobot episode")
    source = f"{folder}:{number}"
    read = {
        key: episode.numbers(key).astype(float) for key in {STATE, ACTION, *(key for key, _ in columns.more.values())}
    }
    position, command = read[STATE][:, columns.state], read[ACTION][:, columns.action]
    check_command(position, command, source)
    units.check(position, columns.joints, source)
    lines = [units.line(joint, info.robot, source) for joint in columns.joints]
    factor, offset = (np.array([line[k] for line in lines]) for k in (0, 1))
    more: dict[str, Any] = {signal: read[key][:, chosen] for signal, (key, chosen) in columns.more.items()}
    more = {
        signal: array * (factor if signal == "velocity" else np.sign(factor))
        for signal, array in more.items()
        if array.any()
    }
    said = [f"{joint}: {line[2]}" for joint, line in zip(columns.joints, lines, strict=True) if line[2]]
    return Recording(
        name=f"{Path(folder).resolve().name}_episode_{number}",
        joints=columns.joints,
        time=np.arange(len(position)) / info.hz,
        position=position * factor + offset,
        command=command * factor + offset,
        units=tuple("1" if j in units.normalised else "m" if j in units.sliding else "rad" for j in columns.joints),
        command_hold=command_hold,
        nominal_time=True,
        source=source,
        notes=(*columns.notes, *said),
        **more,
    )


def check_command(position: np.ndarray, command: np.ndarray, source: str) -> None:
    """Raises: RecordingError where the command (T, n) is really the state of this or a later step, or its change."""
    span = np.ptp(position, axis=0)
    moving = span > MOVES * span.max(initial=0.0)
    if len(position) < 10 or not moving.any():
        return
    x, u, span = position[:, moving], command[:, moving], span[moving]
    later = ("the state of the same step", "the next state", "the state after the next", "the state 3 steps later")
    others = [(what, x[k:], u[: len(u) - k]) for k, what in enumerate(later)]
    for what, state, action in [*others, ("the change of the state", np.diff(x, axis=0), u[:-1])]:
        difference = np.abs(action - state)
        same = (difference <= NEXT * span).mean(axis=0) >= CLOSE
        if same.mean() > 0.5:
            largest = float(np.quantile(difference[:, same], CLOSE))
            alike = float(np.mean([np.corrcoef(action[:, j], state[:, j])[0, 1] for j in np.flatnonzero(same)]))
            raise RecordingError(
                f"{source}: its action is {what} (they differ by at most {largest:.2g} in {CLOSE:.0%} of the steps, correlation "
                f"{alike:.6f}), not a command; record what was sent to the motors"
            )
