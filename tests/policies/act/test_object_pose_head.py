"""Objects found by eyes that learnt from masks."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.policies.act import (
    Act,
    ActPolicy,
    ActTraining,
    Samples,
    TrainingConfig,
    train,
    with_object_poses,
)
from embodiedreamer_gym.policies.act import object_pose_head as module
from embodiedreamer_gym.policies.act.object_pose_head import POSE_SIZE, ObjectPoseHead, mask_poses
from tests.policies.act.tiny import CONFIG, Tiny


class Masked(Tiny):
    """The tiny episodes, with masks of the square; something else is number 4."""

    objects = {"thing": 7}

    def masks(self, i: int, camera: str, start: int, stop: int) -> np.ndarray:
        frames = self.frames(i, camera, start, stop)
        masks = np.where(frames[..., 1] == 250, 7, 4).astype(np.uint8)
        return masks


def bar(x: float, y: float, angle: float, length: float = 10.0, width: float = 3.0) -> torch.Tensor:
    """A mask (1, 1, 48, 64) of a bar around a place from the middle."""
    rows, columns = torch.meshgrid(torch.arange(48.0) - 23.5, torch.arange(64.0) - 31.5, indexing="ij")
    c, s = np.cos(angle), np.sin(angle)
    along, across = c * (columns - x) + s * (rows - y), c * (rows - y) - s * (columns - x)
    return ((along.abs() < length) & (across.abs() < width)).float()[None, None]


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, 2.5])
def test_a_mask_says_where_a_thing_is_and_how_it_lies(angle: float) -> None:
    x, y, cosine, sine, size, area = mask_poses(bar(9.0, -6.0, angle))[0].tolist()
    assert (32 * x, 24 * y) == (pytest.approx(9.0, abs=0.3), pytest.approx(-6.0, abs=0.3))
    specks = bar(9.0, -6.0, angle)
    specks[..., 3:5, 3:5] = 1.0
    specks[..., 44:46, 2] = 0.9
    np.testing.assert_allclose(mask_poses(specks)[0], [x, y, cosine, sine, size, area], atol=1e-5)
    off = 0.5 * np.arctan2(sine, cosine) - angle
    assert abs(np.sin(off)) < 0.03 and np.hypot(cosine, sine) > 0.75
    larger = mask_poses(bar(9.0, -6.0, angle, 14.0, 4.0))[0].tolist()
    assert larger[4] > size and larger[5] > area


def test_what_is_seen_elsewhere_does_not_count() -> None:
    """Another thing of half the size at the rim, for instance a part of an arm in a like colour."""
    alone = bar(9.0, -6.0, 0.4)
    both = torch.maximum(alone, bar(-24.0, 12.0, 1.0, 5.0, 3.0))
    np.testing.assert_array_equal(mask_poses(both), mask_poses(alone))


def test_a_finger_in_front_does_not_cut_a_thing_in_two() -> None:
    cut = bar(9.0, -6.0, 0.0)
    cut[..., 44:46] = 0.0
    whole, seen = mask_poses(bar(9.0, -6.0, 0.0))[0], mask_poses(cut)[0]
    np.testing.assert_allclose(seen[:2], whole[:2], atol=0.06)  # 2 pixels
    assert abs(float(seen[4] - whole[4])) < 0.1 * float(whole[4])


def test_nothing_seen_is_finite() -> None:
    assert bool(torch.isfinite(mask_poses(torch.zeros(2, 3, 8, 8))).all())
    assert mask_poses(torch.zeros(2, 3, 8, 8)).shape == (2, 3 * POSE_SIZE)


def test_objects_are_found_where_no_demonstration_had_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """To a tenth of the picture's width, after a few steps on a few places."""
    monkeypatch.setattr(module, "LEAST_STEPS", 150)
    config = with_object_poses(CONFIG, Masked())
    assert config.objects == ("thing",) and config.keypoints == 0 and with_object_poses(CONFIG, Tiny()) == CONFIG
    pictures, masks = Samples(Masked(lengths=(9,) * 8), config).masked_pictures("head")
    assert set(np.unique(masks)) == {0, 1} and pictures.shape[:3] == masks.shape and len(masks) == 8 * 3
    assert len(Samples(Masked(lengths=(9,) * 8), config, memory=24 * 32 * 4 * 9).masked_pictures("head")[0]) == 8 * 2
    torch.manual_seed(0)
    eyes = ObjectPoseHead(1)

    def ready(seen: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(seen).permute(0, 3, 1, 2).float() / 128.0 - 1.0

    eyes.fit(pictures, masks, ready, 0)
    other = Masked(lengths=(9,) * 8, seed=5)
    seen, _ = Samples(other, config).masked_pictures("head")
    told = (eyes(ready(seen)) * eyes.pose_scale + eyes.pose_mean)[:, 0].numpy()
    truth = np.repeat([(int(x * 28) + 1.5 - 15.5) / 16 for x in other.columns], 3)
    assert np.abs(told - truth).max() < 0.1
    assert not eyes(ready(seen)).requires_grad


def test_many_episodes_are_looked_at_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """As each may show another look; but not for ever."""
    for name, value in (("LEAST_STEPS", 4), ("STEPS_PER_EPISODE", 2), ("MOST_STEPS", 10)):
        monkeypatch.setattr(module, name, value)
    taken = {}
    for count in (1, 3, 50):
        said: list[int] = []
        samples = Samples(Masked(lengths=(2,) * count), with_object_poses(CONFIG, Masked()))
        Act(samples.config).learn_object_poses(
            samples, 0, lambda stage, step, of, *, said=said, **more: said.append(of)
        )
        taken[count] = (len(said), said[-1])
    assert taken == {1: (4, 4), 3: (6, 6), 50: (10, 10)}


def test_a_policy_with_eyes_is_trained_saved_and_gone_on_with(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LEAST_STEPS", 3)
    monkeypatch.setattr(module, "STEPS_PER_EPISODE", 1)
    config = with_object_poses(CONFIG, Masked()).with_(image_size=(16, 12))
    said: list[str] = []
    one = train(Masked(), config, TrainingConfig(steps=4, batch=4), tmp_path / "a",
                lambda stage, count, of, **more: said.append(stage))  # fmt: skip
    assert said == ["object pose head"] * 3 + ["object poses"] * 3 + ["training"] * 4
    two = ActPolicy.load(tmp_path / "a")
    batch = {"agent_pos": np.zeros((2, 3), np.float32), "pixels": {"head": Masked().frames(0, "head", 0, 2)}}
    np.testing.assert_array_equal(one(batch), two(batch))
    said.clear()
    train(Masked(), config, TrainingConfig(steps=4, batch=4), tmp_path / "a",
          lambda stage, count, of, **more: said.append(stage))  # fmt: skip
    assert said == []  # done: neither looked nor trained again


def test_what_is_done_stays_done() -> None:
    """Past an episode's end its last action counts, unless it is not known."""
    for rest in (True, False):
        training = ActTraining(Samples(Tiny(lengths=(2,)), CONFIG), TrainingConfig(steps=8, batch=4, rest=rest))
        before = float(training.loss(0)["l1"].detach())
        with torch.no_grad():  # what is said of the last step of a chunk that is longer than the episode
            training.network.queries.weight[3] += 100.0
        assert (abs(float(training.loss(0)["l1"].detach()) - before) > 1e-3) == rest


def test_what_the_eyes_told_stands_for_the_pictures(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Training on it is the same, and goes on as if it had not been interrupted, with a latent too."""
    monkeypatch.setattr(module, "LEAST_STEPS", 3)
    monkeypatch.setattr(module, "STEPS_PER_EPISODE", 1)
    config = with_object_poses(CONFIG, Masked()).with_(latent=2)
    seen, told = (ActTraining(Samples(Masked(), config), TrainingConfig(steps=4, batch=4)) for _ in range(2))
    told.samples.keep_object_poses(told.network.object_poses)
    assert told.samples.has_object_poses and "pixels" not in told.samples.draw(np.random.default_rng(0), 2).batch
    torch.testing.assert_close(told.loss(1)["loss"], seen.loss(1)["loss"])
    batch = {"agent_pos": np.zeros((2, 3), np.float32), "pixels": {"head": Masked().frames(0, "head", 0, 2)}}
    digested = told.network.precompute(batch)
    assert set(digested) == {"agent_pos", "object_poses"} and told.network.precompute(digested) is digested
    torch.testing.assert_close(told.network.mean(digested), told.network.mean(batch))
    whole = train(Masked(), config, TrainingConfig(steps=4, batch=4), tmp_path / "a")
    monkeypatch.setattr("embodiedreamer_gym.learning.training.SAVED_EVERY", 2)

    def stop(stage: str, count: int, of: int, **more: str) -> None:
        if (stage, count) == ("training", 3):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(Masked(), config, TrainingConfig(steps=4, batch=4), tmp_path / "b", stop)
    again = train(Masked(), config, TrainingConfig(steps=4, batch=4), tmp_path / "b")
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, again.network.state_dict()[name]), name


def test_a_network_with_eyes_asks_for_more_steps() -> None:
    assert TrainingConfig.usual(CONFIG) == TrainingConfig()
    eyes = TrainingConfig.usual(with_object_poses(CONFIG, Masked()), steps=None, seed=3)
    assert (eyes.steps, eyes.batch, eyes.seed) == (8000, 64, 3)
