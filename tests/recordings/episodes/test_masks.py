"""Masks of objects beside the frames of HDF5 episodes."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes import mixed, open_episodes, write_aloha_episode

NAMES = ("background", "table", "robot", "cup", "mat")
FRAMES = np.random.default_rng(0).integers(0, 255, (5, 6, 8, 3), np.uint8)
MASKS = np.random.default_rng(1).integers(0, 5, (5, 6, 8), np.uint8)


def write(path: Path, masks: np.ndarray | None = MASKS, names: tuple[str, ...] = NAMES) -> Path:
    path.parent.mkdir(exist_ok=True)
    rest = np.zeros((5, 3))
    write_aloha_episode(path, rest, rest, {"head": FRAMES}, hz=30, masks=None if masks is None else {"head": masks},
                        classes=names)  # fmt: skip
    return path


def test_masks_are_read_by_windows_and_say_which_objects(tmp_path: Path) -> None:
    write(tmp_path / "a" / "episode_0.hdf5")
    episodes = open_episodes(tmp_path / "a")
    assert episodes.objects == {"cup": 3, "mat": 4}
    np.testing.assert_array_equal(episodes.masks(0, "head", 1, 4), MASKS[1:4])
    assert episodes.masks(0, "head", 2, 2).shape == (0, 6, 8)
    with pytest.raises(RecordingError, match="has no camera 'left'"):
        episodes.masks(0, "left")
    with pytest.raises(RecordingError, match=r"not 3 \.\. 8"):
        episodes.masks(0, "head", 3, 9)


def test_sets_that_are_joined_keep_masks_that_all_have(tmp_path: Path) -> None:
    for name, masks in (("a", MASKS), ("b", MASKS[::-1]), ("c", None)):
        write(tmp_path / name / "episode_0.hdf5", masks)
    both = mixed(tmp_path / "a", tmp_path / "b")
    assert both.objects == {"cup": 3, "mat": 4}
    np.testing.assert_array_equal(both.masks(1, "head"), MASKS[::-1])
    other = mixed(tmp_path / "a", tmp_path / "c")
    assert other.objects == {}
    with pytest.raises(RecordingError, match="has no masks of objects"):
        other.masks(0, "head")


def test_masks_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a" / "episode_0.hdf5")
    with h5py.File(path, "r+") as file:
        del file["observations/masks/head"]
        file["observations/masks/head"] = MASKS[:3]
    with pytest.raises(RecordingError, match=r"masks/head is uint8 of shape \(3, 6, 8\)"):
        open_episodes(tmp_path / "a")
    with pytest.raises(RecordingError, match="camera head has 3 frames for 5 steps"):
        write(tmp_path / "b" / "episode_0.hdf5", MASKS[:3])
    assert not any((tmp_path / "b").iterdir())


def test_files_of_one_set_agree_in_masks_and_names_that_are_none_are_none(tmp_path: Path) -> None:
    write(tmp_path / "a" / "episode_0.hdf5")
    write(tmp_path / "a" / "episode_1.hdf5", None)
    with pytest.raises(RecordingError, match="has masks of nothing"):
        open_episodes(tmp_path / "a")
    write(tmp_path / "c" / "episode_0.hdf5")
    write(tmp_path / "c" / "episode_1.hdf5", names=("more", *NAMES))
    with pytest.raises(RecordingError, match=r"has masks of more \(0\)|has masks of .* \(\d\)"):
        open_episodes(tmp_path / "c")
    path = write(tmp_path / "b" / "episode_0.hdf5")
    with h5py.File(path, "r+") as file:
        file.attrs["class_names"] = "no JSON"
    assert open_episodes(tmp_path / "b").objects == {}
