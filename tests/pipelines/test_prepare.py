"""Real recordings become episodes; the robot's view is that of the environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.engines.robot_view import RobotView
from embodiedreamer_gym.engines.table import TABLE_HEIGHT
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.pipelines.prepare import prepare, write_episode
from embodiedreamer_gym.recordings import Recording, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.vis_aligner import load_bank, load_episode
from tests.opengl import skip_without_pictures
from tests.wrappers.test_action_chunk import ID, actions

SIZE = (64, 48)
COUNT = 12
HOME = (0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0)  # of an arm and its gripper
LOOKING_DOWN = ((-0.23, 1.2, -0.9, 0.0, 0.9, 0.0), (0.2, 1.4, -1.1, 0.2, 0.9, 0.3))


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


@pytest.mark.parametrize("engine", ["auto", "mujoco"])
def test_a_camera_on_the_robot_sees_the_table_below_it(engine: str) -> None:
    """Where the environment shows its table, at the same depth, with the same numbers and projections of the parts."""
    if engine == "mujoco":
        skip_without_pictures()
    env, camera = gym.make(ID, obs_type="state", disable_env_checker=True).unwrapped, CAMERAS["left_wrist"]
    with RobotView(RobotModel.load("aloha"), camera, SIZE, engine, TABLE_HEIGHT) as view:
        for pose in LOOKING_DOWN:
            env.reset(seed=2, options={"joint_positions": np.array([*pose, 1.0, *HOME])})
            true, found = env.capture("left_wrist", SIZE), view.at(env.joint_positions())
            table = (true.segmentation == 1) & (found.segmentation != 2)
            assert table.sum() > 500 and (found.segmentation[table] == 1).mean() > 0.98
            assert np.median(np.abs(found.depth - true.depth)[table]) < 2e-3
            assert (found.parts[table] == true.parts[table]).mean() > 0.98
            links = found.projections.shape[0]
            np.testing.assert_allclose(found.projections, true.projections[:links], atol=0.05)
    env.close()


def test_a_bank_knows_the_view_of_a_camera_on_the_robot(log, tmp_path, capsys) -> None:
    recording, model, _ = log
    env, seen = gym.make(ID, obs_type="state", disable_env_checker=True).unwrapped, []
    env.reset(seed=2)
    for action in actions(COUNT):
        env.step(action)
        seen.append(env.capture("left_wrist", SIZE).rgb)
    env.close()
    wrist = recording.with_(frames={"left_wrist": Frames(seen)})
    write_episode(prepare(recording, model, CAMERAS["head"], SIZE), tmp_path / "fixed.hdf5")
    moving = prepare(wrist, model, CAMERAS["left_wrist"], SIZE, table=TABLE_HEIGHT)
    write_episode(moving, tmp_path / "wrist.hdf5")
    out = tmp_path / "bank.npz"
    words = [
        "vis",
        "bank",
        str(tmp_path / "fixed.hdf5"),
        "--moving-episodes",
        str(tmp_path / "wrist.hdf5"),
        "--out",
        str(out),
    ]
    assert main([*words, "--quiet"]) == 0
    bank = load_bank(out)
    assert bank.moving is not None and bank.moving.atlas is not None
    composed = bank.compose(moving.condition.part(6, 7)).astype(float)
    table = moving.condition.classes[6] == 1
    assert np.median(np.abs(composed - seen[6])[table]) < 10


def test_what_does_not_fit_is_refused(log, tmp_path, capsys) -> None:
    recording, model, _ = log
    with pytest.raises(VisionError, match="no video of camera 'left'; it has head"):
        prepare(recording, model, CAMERAS["head"].with_(name="left"), SIZE)
    with pytest.raises(SimulationError, match="give the height of the table"):
        prepare(recording.with_(frames={"left_wrist": recording.frames["head"]}), model, CAMERAS["left_wrist"], SIZE)
    save_recording(recording.with_(frames={}), tmp_path / "take_1.hdf5")
    arguments = ["vis", "prepare", str(tmp_path / "take_1.hdf5"), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(arguments) == 2 and "the recording has no frames." in capsys.readouterr().err
    assert main([*arguments, "--size", "big"]) == 2 and main([*arguments, "--camera", "top"]) == 2
    assert not (tmp_path / "out").exists()
