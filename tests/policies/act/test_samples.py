"""What is drawn from episodes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act import Samples, picture_size
from embodiedreamer_gym.policies.act.image_size import scaled
from tests.policies.act.tiny import CONFIG, SIZE, Tiny


def test_a_start_and_what_followed() -> None:
    episodes = Tiny()
    sample = Samples(episodes, CONFIG).at(np.array([0, 5, 7, 12]))  # of lengths 7, 5, 9
    assert sample.actions.shape == (4, 4, 2) and sample.batch["agent_pos"].shape == (4, 3)
    np.testing.assert_array_equal(sample.padding, [[0] * 4, [0, 0, 1, 1], [0] * 4, [0] * 4])
    np.testing.assert_allclose(sample.actions[0, :, 1], [0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(sample.actions[1, :, 1], [0.5, 0.6, 0.6, 0.6])  # repeats the last one
    np.testing.assert_array_equal(sample.batch["pixels"]["head"][:, 0, 0, 0], [0, 5, 0, 0])  # the frame of that step
    np.testing.assert_array_equal(sample.batch["agent_pos"][3], episodes.states(2)[0])


def test_each_step_is_drawn_as_often() -> None:
    samples = Samples(Tiny(), CONFIG)
    assert len(samples) == 21
    drawn = samples.draw(np.random.default_rng(0), 4200).batch["pixels"]["head"][:, 0, 0, 0]
    assert np.abs(np.bincount(drawn)[:5] / 600 - 1).max() < 0.15  # steps 0 .. 4 are in all three episodes
    assert abs(np.bincount(drawn)[8] / 200 - 1) < 0.25


@pytest.mark.parametrize("size", [SIZE, (64, 48)])
def test_pictures_that_do_not_fit_in_memory_are_read_when_drawn(size: tuple[int, int]) -> None:
    episodes = Tiny(cameras=("head", "left"), size=size)
    config = CONFIG.with_(cameras=("left", "head"))
    kept, read = Samples(episodes, config), Samples(episodes, config, memory=1)
    assert "in memory" in repr(kept) and "read when drawn" in repr(read)
    episodes.read.clear()
    steps = np.array([3, 20, 0])
    one, two = kept.at(steps), read.at(steps)
    assert episodes.read == [1] * 6  # only those frames
    for camera in config.cameras:
        np.testing.assert_array_equal(one.batch["pixels"][camera], two.batch["pixels"][camera])
        assert one.batch["pixels"][camera].shape == (3, *SIZE[::-1], 3)


def test_long_episodes_are_read_in_blocks() -> None:
    episodes = Tiny(lengths=(150,))
    Samples(episodes, CONFIG)
    assert episodes.read == [64, 64, 22]


def test_scaling() -> None:
    frames = np.zeros((2, 8, 12, 3), np.uint8)
    frames[1, :, :6] = 200
    half = scaled(frames, (6, 4))
    assert half.shape == (2, 4, 6, 3) and half[1, :, :3].min() == 200 and half[1, :, 3:].max() == 0
    assert scaled(frames, (12, 8)) is frames
    assert scaled(frames, (24, 16)).shape == (2, 16, 24, 3)


def test_picture_size() -> None:
    assert picture_size(Tiny(size=(40, 30)), "head") == (40, 30)


def test_the_fingerprint_tells_sets_apart() -> None:
    one = Samples(Tiny(), CONFIG).fingerprint
    assert one == Samples(Tiny(), CONFIG).fingerprint
    for other in (Tiny(seed=1), Tiny(lengths=(7, 5, 8))):
        assert Samples(other, CONFIG).fingerprint != one


def test_what_is_refused() -> None:
    with pytest.raises(PolicyError, match="no episode to learn from"):
        Samples(Tiny(lengths=()), CONFIG)
    with pytest.raises(PolicyError, match="no pictures of the camera 'wrist'; cameras: head"):
        Samples(Tiny(), CONFIG.with_(cameras=("wrist",)))
    with pytest.raises(PolicyError, match=r"episode_0: actions have the shape \(7, 2\), but the policy needs 14"):
        Samples(Tiny(), CONFIG.with_(action_size=14))
    episodes = Tiny()
    episodes.missing = 2
    with pytest.raises(PolicyError, match="episode_0 lacks pictures of the camera 'head' from step 0 on"):
        Samples(episodes, CONFIG)
    episodes = Tiny()
    episodes.actions(1)[3, 0] = np.nan
    with pytest.raises(PolicyError, match="episode_1: the action at step 3 is not finite"):
        Samples(episodes, CONFIG)


def test_starts_near_where_a_policy_is_asked_are_drawn_more_often() -> None:
    """With chunks of 4 nothing is far from a chunk's start; with chunks of 20, steps 0 to 7, 20 to 27, and so on."""
    config = CONFIG.with_(chunk=20)
    samples = Samples(Tiny(lengths=(50, 30)), config)

    def near(share: float) -> float:
        drawn = samples.draw(np.random.default_rng(0), 400, share)
        steps = drawn.batch["pixels"]["head"][:, 0, 0, 0]  # the picture tells its step
        return float(np.mean(steps % 20 < 8))

    assert near(1.0) == 1.0
    assert near(0.0) == pytest.approx(40 / 80, abs=0.08)
    assert near(0.7) == pytest.approx(0.7 + 0.3 * 40 / 80, abs=0.06)
