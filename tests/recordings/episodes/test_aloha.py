"""ALOHA and AgileX files: what is read, in which memory, and what is refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes import open_episodes


@pytest.mark.parametrize("images", ["raw", "gzip", "jpeg"])
def test_what_is_written_is_read(aloha, numbers, seen, images: str) -> None:
    episodes = open_episodes(aloha(images=images))
    assert (len(episodes), episodes.lengths, episodes.names) == (2, (9, 12), ("episode_0", "episode_1"))
    assert (episodes.cameras, episodes.state_size, episodes.action_size) == (("head", "left_wrist"), 14, 14)
    assert episodes.hz == 30.0 and episodes.task(1) == "task 1" and episodes.frame_size("head") == (16, 12)
    for number, length in enumerate(episodes.lengths):
        state, action = numbers(length, seed=number)
        assert np.array_equal(episodes.states(number), state) and episodes.states(number).dtype == np.float32
        assert np.array_equal(episodes.actions(number), action) and episodes.actions(number).dtype == np.float32
    frames = episodes.frames(1, "left_wrist", 3, 7)
    assert frames.shape == (4, 12, 16, 3) and frames.dtype == np.uint8 and seen(frames) == [8, 9, 10, 11]
    assert np.abs(frames[:, :4].astype(int)[..., 0] - frames[:, :4].astype(int)[..., 1] - 40).max() <= 6  # red is red
    assert seen(episodes.frames(0, "head")) == list(range(9))
    assert episodes.frames(0, "head", 4, 4).shape == (0, 12, 16, 3)


def test_a_set_of_act_itself(tmp_path: Path) -> None:
    """As record_episodes.py writes it with `compress`: zero-padded JPEGs, compress_len, no rate, no task."""
    codes = [cv2.imencode(".jpg", np.full((8, 10, 3), 40 * k, np.uint8))[1].ravel() for k in range(3)]
    with h5py.File(tmp_path / "episode_0.hdf5", "w") as file:
        file.attrs.update({"sim": False, "compress": True})
        file["action"], file["observations/qpos"] = np.zeros((3, 14)), np.ones((3, 14))
        padded = np.zeros((3, max(map(len, codes)) + 9), np.uint8)
        for row, code in zip(padded, codes, strict=True):
            row[: len(code)] = code
        file["observations/images/cam_high"] = padded
        file["compress_len"] = np.array([[len(code) for code in codes]], float)
    episodes = open_episodes(tmp_path)
    assert episodes.cameras == ("cam_high",) and episodes.frame_size("cam_high") == (10, 8)
    assert np.abs(episodes.frames(0, "cam_high").mean((1, 2, 3)) - [0, 40, 80]).max() < 2
    assert episodes.task(0) == ""
    with pytest.raises(RecordingError, match="does not state its control rate; give it"):
        _ = episodes.hz
    assert open_episodes(tmp_path, hz=50).hz == 50
    with pytest.raises(RecordingError, match="must be above 0"):
        open_episodes(tmp_path, hz=-1)


def test_times_and_a_task_without_words(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["action"], file["observations/qpos"] = np.zeros((4, 2)), np.zeros((4, 3))
        file["timestamps"] = np.arange(4) / 25
        file.attrs["task"] = "PutCupOnMat"
    episodes = open_episodes(tmp_path / "a.h5")
    assert episodes.hz == pytest.approx(25) and episodes.task(0) == "PutCupOnMat"
    assert (episodes.state_size, episodes.action_size, episodes.cameras) == (3, 2, ())
    with pytest.raises(RecordingError, match="no camera 'head'; it has no frames at all"):
        episodes.frames(0, "head")


def change(change_file: Callable[[h5py.File], None]) -> Callable[[Path], None]:
    """What changes the second file of a folder."""

    def apply(folder: Path) -> None:
        with h5py.File(folder / "episode_1.hdf5", "a") as file:
            change_file(file)

    return apply


def put(key: str, value: np.ndarray) -> Callable[[Path], None]:
    def replace(file: h5py.File) -> None:
        del file[key]
        file[key] = value

    return change(replace)


def link(file: h5py.File) -> None:
    del file["action"]
    file["action"] = h5py.ExternalLink("episode_0.hdf5", "/action")


def outside(file: h5py.File) -> None:
    del file["action"]
    file.create_dataset("action", (12, 14), np.float32, external=[(__file__, 0, 12 * 14 * 4)])


def nan(file: h5py.File) -> None:
    file["action"][3, 7] = np.nan


HEAD = "observations/images/head"
BAD = {
    "frames are missing": put(HEAD, np.zeros((11, 12, 16, 3), np.uint8)),
    "/action has 11 steps, /observations/qpos 12": put("action", np.zeros((11, 14))),
    "not finite at step 3, column 7": change(nan),
    "an action size of 7, episode_0.hdf5 14": put("action", np.zeros((12, 7))),
    "a state size of 2": put("observations/qpos", np.zeros((12, 2))),
    r"frames of \[\(20, 12\)": put(HEAD, np.zeros((12, 12, 20, 3), np.uint8)),
    "is float32 of shape": put(HEAD, np.zeros((12, 12, 16, 3), np.float32)),
    "the cameras left_wrist, episode_0": change(lambda file: file.__delitem__(HEAD)),
    "/action is missing": change(lambda file: file.__delitem__("action")),
    "/observations/qpos is missing": put("observations/qpos", h5py.Empty("f4")),
    "numbers of shape": put("action", np.zeros(12)),
    "points to another file": change(link),
    "/action points to": change(outside),
    "is not a JPEG or PNG": put(HEAD, np.ones((12, 30), np.uint8)),
    "runs at 50 Hz, episode_0.hdf5 at 30": change(lambda file: file.attrs.__setitem__("rate", 50.0)),
    "the rate is nan": change(lambda file: file.attrs.__setitem__("rate", np.nan)),
    "damaged, cut short": lambda folder: (folder / "episode_1.hdf5").write_bytes(
        (folder / "episode_1.hdf5").read_bytes()[:2000]
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_files_are_one_sentence(aloha, message: str) -> None:
    folder = aloha()
    BAD[message](folder)
    with pytest.raises(RecordingError, match=message) as caught:
        open_episodes(folder)
    assert "episode_1.hdf5" in str(caught.value) and "\n" not in str(caught.value)


def test_a_claim_that_would_fill_the_memory(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        for key in ("action", "observations/qpos"):
            file.create_dataset(key, (10**9, 14), np.float32, chunks=(1, 14))
    with pytest.raises(RecordingError, match="claims the shape"):
        open_episodes(tmp_path)


def test_a_frame_that_is_cut_is_named(aloha) -> None:
    folder = aloha(images="jpeg")
    with h5py.File(folder / "episode_1.hdf5", "a") as file:
        file[HEAD][4] = 0
    episodes = open_episodes(folder)
    assert len(episodes.frames(1, "head", 0, 4)) == 4
    with pytest.raises(RecordingError, match=r"frame 4 of /observations/images/head is not a JPEG"):
        episodes.frames(1, "head", 2, 6)


def test_a_long_set_is_read_in_constant_memory(tmp_path: Path) -> None:
    """500 steps of three cameras, 480 x 640: 1.4 GB, of which a window is in memory at a time."""
    with h5py.File(tmp_path / "episode_0.hdf5", "w") as file:
        file["action"], file["observations/qpos"] = np.zeros((500, 14)), np.zeros((500, 14))
        for camera in ("cam_high", "cam_left_wrist", "cam_right_wrist"):
            shape = (500, 480, 640, 3)  # nothing is stored, so that the test needs no disk; zeros are read
            file.create_dataset(f"observations/images/{camera}", shape, np.uint8, chunks=(1, *shape[1:]))
            file[f"observations/images/{camera}"][499] = 9
    code = f"""
import resource
from embodiedreamer_gym.recordings.episodes import open_episodes
episodes = open_episodes({str(tmp_path)!r})
episodes.frames(0, "cam_high", 0, 10)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
frames = total = 0
for camera in episodes.cameras:
    for start in range(0, 500, 10):
        window = episodes.frames(0, camera, start, start + 10)
        frames, total = frames + len(window), total + int(window[-1, 0, 0, 0])
print(frames, total, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    frames, total, megabytes = done.stdout.split()
    assert (int(frames), int(total)) == (1500, 27) and float(megabytes) < 40  # two windows are 18 MB
