"""What is written down of an episode is what the environment did."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.standin.film.play import MARGIN, EpisodePlayer, ExpertEpisode

SEED = 11


@pytest.fixture(scope="module")
def played(stage: EpisodePlayer) -> ExpertEpisode:
    return stage.play(SEED, 60)


def test_the_same_seed_plays_the_same_episode_bit_for_bit(stage: EpisodePlayer, played: ExpertEpisode) -> None:
    seen = []
    again = stage.play(SEED, 25, lambda step: seen.append((step, stage.env.joint_positions())))
    for name in ("position", "action", "poses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(played, name)[:25])
    assert [step for step, _ in seen] == list(range(25))
    np.testing.assert_array_equal([position for _, position in seen], again.position)
    assert again.side == played.side and again.bodies == played.bodies
    assert np.abs(stage.play(SEED + 1, 5).objects["cup"] - again.objects["cup"][:5]).max() > 0.01


def test_rows_are_states_and_the_actions_that_follow_them(stage: EpisodePlayer, played: ExpertEpisode) -> None:
    stage.env.reset(seed=SEED)
    for k in range(40):
        np.testing.assert_array_equal(stage.env.joint_positions(), played.position[k])
        stage.env.step(played.action[k])


def test_poses_are_the_scenes(stage: EpisodePlayer, played: ExpertEpisode) -> None:
    """Of links and props, as matrices; those of the props as position and quaternion too."""
    stage.play(SEED, 60)
    stage.env.reset(seed=SEED)
    for place, name in enumerate(played.bodies):
        here = stage.env.engine.pose(name) if name in stage.props else stage.env.engine.link_pose(name)
        np.testing.assert_allclose(played.poses[0, place, :3, 3], here.position, atol=1e-9)
        np.testing.assert_allclose(played.poses[0, place, :3, :3], here.rotation, atol=1e-9)
    cup = played.poses[:, played.bodies.index("cup")]
    np.testing.assert_allclose(played.objects["cup"][:, :3], cup[:, :3, 3])
    np.testing.assert_allclose(Rotation.from_quat(played.objects["cup"][:, 3:]).as_matrix(), cup[:, :3, :3], atol=1e-9)
    assert set(played.objects) == {"cup", "mat"} and played.bodies[-2:] == ("cup", "mat")


def test_some_steps_alone(played: ExpertEpisode) -> None:
    some = played.select(np.array([3, 7]))
    np.testing.assert_array_equal(some.position, played.position[[3, 7]])
    np.testing.assert_array_equal(some.objects["mat"], played.objects["mat"][[3, 7]])
    assert len(some.poses) == len(some.action) == 2 and repr(some) == f"ExpertEpisode(2 steps, {played.side})"


def test_active_steps_end_after_the_last_motion() -> None:
    position = np.zeros((100, 14))
    position[10:40, 3] = np.linspace(0.0, 1.0, 30)
    position[40:, 3] = 1.0
    made = ExpertEpisode("left", (), position, position, np.zeros((100, 0, 4, 4)), {})
    assert made.active_steps == 39 + MARGIN
    assert made.select(np.arange(45)).active_steps == 45
    still = np.zeros((100, 14))
    assert ExpertEpisode("left", (), still, still, np.zeros((100, 0, 4, 4)), {}).active_steps == MARGIN


def test_the_simulators_picture_is_the_environments(stage: EpisodePlayer) -> None:
    stage.env.reset(seed=SEED)
    ours, theirs = stage.capture(CAMERAS["head"], (128, 96)), stage.env.capture("head", (128, 96))
    np.testing.assert_array_equal(ours.rgb, theirs.rgb)
    np.testing.assert_array_equal(ours.segmentation, theirs.segmentation)
    assert stage.env.engine.renderer_name == "tiny"
