"""Several sets as one: every number and frame is that of its part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes import AlohaWriter, JoinedEpisodes, mixed, open_episodes


def test_it_is_its_parts(aloha: Callable[..., Path], seen) -> None:
    parts = [open_episodes(aloha((5, 7), "a")), open_episodes(aloha((4,), "b"))]
    joined = JoinedEpisodes(parts, ["real", "generated"])
    assert joined.names == ("real/episode_0", "real/episode_1", "generated/episode_0")
    assert joined.lengths == (5, 7, 4) and len(joined) == 3 and joined.hz == 30
    assert joined.cameras == parts[0].cameras and (joined.state_size, joined.action_size) == (14, 14)
    assert "3 episodes, 16 steps" in repr(joined) and joined.frame_size("head") == (16, 12)
    number = 0
    for part in parts:
        for i in range(len(part)):
            assert np.array_equal(joined.states(number), part.states(i))
            assert np.array_equal(joined.actions(number), part.actions(i))
            assert np.array_equal(joined.frames(number, "left_wrist"), part.frames(i, "left_wrist"))
            assert joined.task(number) == part.task(i) == f"task {i}"
            number += 1
    assert seen(joined.frames(2, "head", 1, 3)) == [1, 2]
    with pytest.raises(RecordingError, match=r"generated/episode_0 has the steps 0 \.\. 3"):
        joined.frames(2, "head", 0, 5)


def test_folders_are_opened(aloha: Callable[..., Path]) -> None:
    a, b = aloha((5,), "a"), aloha((4,), "b")
    joined = mixed(a, open_episodes(b))
    assert joined.lengths == (5, 4) and str(joined.names[1]) == "1/episode_0"
    assert mixed(a).names == ("episode_0",)
    with pytest.raises(RecordingError, match="no such file"):
        mixed(a, a / "none")


def write(folder: Path, numbers, hz: float = 30, size: tuple[int, int] = (16, 12), **sizes: int) -> Path:
    """One episode with one camera."""
    with AlohaWriter(folder, hz) as writer:
        frames = [np.zeros((size[1], size[0], 3), np.uint8)] * 3
        writer.add_episode(*numbers(3, **sizes), {"head": frames})
    return folder


def test_cameras_that_not_all_have(aloha: Callable[..., Path], tmp_path: Path, numbers) -> None:
    two, one = open_episodes(aloha((5,), "a")), open_episodes(write(tmp_path / "b", numbers))
    with pytest.raises(RecordingError, match="has the cameras head, but needed are head, left_wrist"):
        mixed(two, one)
    with pytest.raises(RecordingError, match="has the cameras head, left_wrist, but needed are head"):
        mixed(one, two)
    joined = mixed(two, one, cameras=("head",))
    assert joined.cameras == ("head",) and joined.lengths == (5, 3)
    with pytest.raises(RecordingError, match="has no camera 'left_wrist'"):
        joined.frames(0, "left_wrist")


def test_sets_that_do_not_fit(tmp_path: Path, numbers) -> None:
    base = open_episodes(write(tmp_path / "a", numbers))
    for name, options, said in (
        ("large", {"size": (32, 24)}, "frames of 32 x 24 of head"),
        ("arm", {"n": 7}, "an action size of 7"),
    ):
        with pytest.raises(RecordingError, match=said):
            mixed(base, write(tmp_path / name, numbers, **options))
    with pytest.raises(RecordingError, match="different rates"):
        print(mixed(base, write(tmp_path / "fast", numbers, hz=50)).hz)
    with pytest.raises(RecordingError, match="no episodes to join"):
        mixed()
    with pytest.raises(RecordingError, match="different names"):
        JoinedEpisodes([base, base], ["real", "real"])
