"""Which files and folders are episodes."""

from __future__ import annotations

from pathlib import Path

import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes import open_episodes


def test_a_folder_in_natural_order_and_one_file(aloha) -> None:
    folder = aloha(lengths=(1,) * 11)
    (folder / ".episode_11.hdf5.part").touch()
    (folder / ".hidden.hdf5").touch()
    assert open_episodes(folder).names == tuple(f"episode_{k}" for k in range(11))
    assert open_episodes(str(folder / "episode_7.hdf5")).names == ("episode_7",)
    assert repr(open_episodes(folder)).startswith(
        "AlohaEpisodes(11 episodes, 11 steps, state 14, action 14, cameras head"
    )


@pytest.mark.parametrize(
    ("name", "message"),
    [("nothing", "there is no such file or folder"), ("empty", "there is no episode"), ("a.csv", "suffix '.csv'")],
)
def test_what_is_no_set(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.csv").touch()
    with pytest.raises(RecordingError, match=message):
        open_episodes(tmp_path / name)


def test_steps_that_there_are_not(aloha) -> None:
    episodes = open_episodes(aloha())
    for start, stop in ((-1, 3), (3, 10), (5, 4)):
        with pytest.raises(RecordingError, match=r"episode_0 has the steps 0 \.\. 8"):
            episodes.frames(0, "head", start, stop)
    with pytest.raises(RecordingError, match="has no camera 'wrist'; it has head, left_wrist"):
        episodes.frames(0, "wrist")
