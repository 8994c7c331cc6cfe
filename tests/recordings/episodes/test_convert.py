"""From one format to the other and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.recordings.episodes import AlohaWriter, LeRobotWriter, copy_episodes, frames_of, open_episodes
from embodiedreamer_gym.recordings.episodes.convert import READ_FRAMES


def test_there_and_back(aloha, tmp_path: Path, seen) -> None:
    pytest.importorskip("av", reason="LeRobot sets need av")
    pytest.importorskip("pyarrow", reason="LeRobot sets need pyarrow")
    first, told = open_episodes(aloha()), []
    with LeRobotWriter(tmp_path / "lerobot", first.hz) as writer:
        copy_episodes(first, writer, progress=told.append)
    second = open_episodes(tmp_path / "lerobot")
    with AlohaWriter(tmp_path / "back", second.hz) as writer:
        copy_episodes(second, writer, count=1)
    third = open_episodes(tmp_path / "back")
    assert told == [1, 2] and len(second) == 2 and len(third) == 1
    assert second.task(1) == "task 1" and third.task(0) == "task 0"
    assert np.array_equal(third.states(0), first.states(0)) and np.array_equal(third.actions(0), first.actions(0))
    assert seen(third.frames(0, "left_wrist")) == list(range(5, 14))


def test_frames_are_read_a_window_at_a_time(aloha, tmp_path: Path, seen, monkeypatch: pytest.MonkeyPatch) -> None:
    episodes = open_episodes(aloha(lengths=(2 * READ_FRAMES + 1,)))
    asked, frames = [], type(episodes).frames
    monkeypatch.setattr(type(episodes), "frames", lambda self, *a: (asked.append(a[2:]), frames(self, *a))[1])
    assert seen(np.array(list(frames_of(episodes, 0, "head")))) == list(range(2 * READ_FRAMES + 1))
    assert asked == [(0, READ_FRAMES), (READ_FRAMES, 2 * READ_FRAMES), (2 * READ_FRAMES, 2 * READ_FRAMES + 1)]
    with AlohaWriter(tmp_path / "copy", 30) as writer:
        copy_episodes(episodes, writer, "another task")
    assert open_episodes(tmp_path / "copy").task(0) == "another task"
