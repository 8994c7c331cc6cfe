"""Files as the robots' own scripts write them, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.recordings.episodes import AlohaWriter, open_episodes, write_aloha_episode


def test_the_layout_of_agilex(aloha) -> None:
    """What collect_data.py writes and the loaders of ACT and Cobot Magic index."""
    with h5py.File(aloha() / "episode_1.hdf5") as file:
        shapes = {key: (file[key].shape, file[key].dtype) for key in ("action", "base_action")}
        assert shapes == {"action": ((12, 14), np.float32), "base_action": ((12, 2), np.float32)}
        for key in ("qpos", "qvel", "effort"):
            assert file[f"observations/{key}"].shape == (12, 14)
        images = file["observations/images/head"]
        assert (images.shape, images.dtype, images.chunks) == ((12, 12, 16, 3), np.uint8, (1, 12, 16, 3))
        assert images.compression is None and "compress_len" not in file
        assert bool(file.attrs["sim"]) and not bool(file.attrs["compress"])


def test_jpeg_buffers_are_padded_with_zeros(tmp_path: Path, numbers) -> None:
    rng = np.random.default_rng(0)
    frames = [np.zeros((64, 64, 3), np.uint8), rng.integers(0, 255, (64, 64, 3)).astype(np.uint8)] * 2
    write_aloha_episode(tmp_path / "a.hdf5", *numbers(4), {"head": iter(frames)}, hz=30, images="jpeg")
    with h5py.File(tmp_path / "a.hdf5") as file:
        codes, lengths = file["observations/images/head"][()], file["compress_len"][()]
        assert bool(file.attrs["compress"]) and lengths.shape == (1, 4) and codes.dtype == np.uint8
        assert lengths[0, 1] > 4096 > lengths[0, 0]  # the room has grown
        for code, length in zip(codes, lengths[0], strict=True):
            assert bytes(code[length - 2 : length]) == b"\xff\xd9" and not code[length:].any()
    assert open_episodes(tmp_path).frames(0, "head", 0, 1).max() < 3


def test_more_that_is_known(tmp_path: Path, numbers) -> None:
    states, actions = numbers(20)
    with AlohaWriter(tmp_path, 30, joint_names=["a", "b"], sim=False) as writer:
        cup = np.tile([0.5, 0, 0.7, 0, 0, 0, 1], (20, 1))
        writer.add_episode(states[:, :2], actions[:, :2], {}, "do it", velocities=states[:, 2:4], objects={"cup": cup},
                           attributes={"side": "left", "camera": {"fx": 1.0}})  # fmt: skip
    with h5py.File(tmp_path / "episode_0.hdf5") as file:
        assert np.array_equal(file["objects/cup"], cup) and not file.attrs["sim"]
        assert (file.attrs["side"], file.attrs["camera"], file.attrs["instruction"]) == ("left", '{"fx": 1.0}', "do it")
    recording = load_recordings(tmp_path)[0]
    assert recording.joints == ("a", "b") and recording.hz == pytest.approx(30) and recording.effort is None
    assert np.array_equal(recording.velocity, states[:, 2:4])


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (lambda shots: shots(8), "camera head has 8 frames for 9 steps; frames are missing"),
        (lambda shots: shots(10), "camera head has more than 9 frames"),
        (lambda shots: [*shots(8), np.zeros((3, 4, 3), np.uint8)], "several sizes"),
        (lambda shots: [np.zeros((3, 4, 3))] * 9, r"float64 of shape \(3, 4, 3\)"),
    ],
)
@pytest.mark.parametrize("images", ["raw", "jpeg"])
def test_nothing_half_written_is_left(tmp_path: Path, numbers, shots, frames, message: str, images: str) -> None:
    writer = AlohaWriter(tmp_path, 30, images)
    with pytest.raises(RecordingError, match=message):
        writer.add_episode(*numbers(9), {"head": frames(shots)})
    assert list(tmp_path.iterdir()) == []


def test_frames_are_taken_in_turn(tmp_path: Path, numbers) -> None:
    order = []

    def camera(name: str):
        for step in range(3):
            order.append((name, step))
            yield np.zeros((4, 4, 3), np.uint8)

    AlohaWriter(tmp_path, 30).add_episode(*numbers(3), {"a": camera("a"), "b": camera("b")})
    assert order == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]


def test_what_cannot_be(tmp_path: Path, numbers) -> None:
    with pytest.raises(RecordingError, match="images 'png' is not one of raw, gzip, jpeg"):
        AlohaWriter(tmp_path, 30, "png")
    states, actions = numbers(4)
    with pytest.raises(RecordingError, match="/action has 4 steps for 3 states"):
        write_aloha_episode(tmp_path / "a.hdf5", states[:3], actions, {}, hz=30)
    states[1, 2] = np.inf
    with pytest.raises(RecordingError, match="states is not finite at step 1, column 2"):
        write_aloha_episode(tmp_path / "a.hdf5", states, actions, {}, hz=30)
    (tmp_path / "old.hdf5").touch()
    with pytest.raises(RecordingError, match="holds episodes already"):
        AlohaWriter(tmp_path, 30)
    with pytest.raises(RecordingError, match="cannot be written"):
        AlohaWriter(tmp_path / "old.hdf5" / "below", 30)
