"""Real recordings become episodes; the robot's view is that of the environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.pipelines.prepare import prepare, write_episode
from embodiedreamer_gym.recordings import Recording, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.vis_aligner import load_episode
from tests.wrappers.test_action_chunk import ID, actions

SIZE = (64, 48)
COUNT = 12


class Frames(list):
    """Pictures in memory."""


@pytest.fixture(scope="module")
def log():
    """A log of joints with a video, and what the environment's own camera shows of them."""
    env = gym.make(ID, obs_type="state", disable_env_checker=True).unwrapped
    env.reset(seed=2)
    positions, views = [], []
    for action in actions(COUNT):
        env.step(action)
        positions.append(env.joint_positions())
        views.append(env.capture("head", SIZE))
    env.close()
    model = RobotModel.load("aloha")
    position = np.array(positions)
    frames = Frames(np.repeat(np.repeat(255 - view.rgb, 2, 0), 2, 1) for view in views)
    recording = Recording("take_1", model.joints, np.arange(COUNT) / 30, position, position, units=model.units,
                          frames={"head": frames})  # fmt: skip
    return recording, model, views


def test_the_robot_is_where_the_environment_shows_it(log) -> None:
    recording, model, views = log
    episode = prepare(recording, model, CAMERAS["head"], SIZE)
    assert episode.frames.shape == (COUNT, 48, 64, 3)
    for frame, classes, view in zip(episode.frames, episode.condition.classes, views, strict=True):
        true = view.segmentation == 2
        shown = (classes == 2) & (view.segmentation != 1)  # the table hides nothing here but what is below it
        assert (shown & true).sum() / (shown | true).sum() > 0.97
        assert np.array_equal(frame, 255 - view.rgb)


def test_masks_lie_over_the_robot(log) -> None:
    recording, model, _ = log
    mask = np.zeros((96, 128), np.uint8)
    mask[:40, :50] = 3
    episode = prepare(recording, model, CAMERAS["head"], SIZE, lambda frame, number: mask)
    assert (episode.condition.classes[:, :20, :25] == 3).all() and not (episode.condition.classes[:, 25:] == 3).any()


def test_an_episode_survives_its_file(log, tmp_path) -> None:
    recording, model, _ = log
    episode = prepare(recording, model, CAMERAS["head"], SIZE)
    write_episode(episode, tmp_path / "take_1.hdf5")
    again = load_episode(tmp_path / "take_1.hdf5")
    assert np.array_equal(again.frames, episode.frames) and again.name == "take_1"
    assert np.array_equal(again.condition.rgb, episode.condition.rgb)
    assert np.abs(again.condition.depth - episode.condition.depth).max() < 5e-2
    assert [p.name for p in tmp_path.iterdir()] == ["take_1.hdf5"]


def test_what_does_not_fit_is_refused(log, tmp_path, capsys) -> None:
    recording, model, _ = log
    with pytest.raises(VisionError, match="no video of camera 'left'; it has head"):
        prepare(recording, model, CAMERAS["head"].with_(name="left"), SIZE)
    with pytest.raises(SimulationError, match="a fixed camera"):
        prepare(recording.with_(frames={"left_wrist": recording.frames["head"]}), model, CAMERAS["left_wrist"], SIZE)
    save_recording(recording.with_(frames={}), tmp_path / "take_1.hdf5")
    arguments = ["vis", "prepare", str(tmp_path / "take_1.hdf5"), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(arguments) == 2 and "the recording has no frames." in capsys.readouterr().err
    assert main([*arguments, "--size", "big"]) == 2 and main([*arguments, "--camera", "top"]) == 2
    assert not (tmp_path / "out").exists()
