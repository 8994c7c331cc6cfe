"""Key poses whose look is taught by generated first frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.pipelines.key_pose_scenes import FIRST_SEED, draw_scenes, lying


def test_scenes_are_composed_with_their_masks() -> None:
    scenes, plain = draw_scenes("PutRemoteInBox", 2), draw_scenes("PutRemoteInBox", 2, bank=None)
    assert scenes.things == ("remote", "box") and scenes.pictures.shape == (2, 96, 128, 3)
    assert np.array_equal(scenes.masks, plain.masks) and set(np.unique(scenes.masks)) == {0, 1, 2}
    assert np.abs(scenes.pictures.astype(float) - plain.pictures).mean() > 5
    assert np.array_equal(draw_scenes("PutRemoteInBox", 1).pictures[0], scenes.pictures[0])
    assert not np.array_equal(scenes.masks[0], scenes.masks[1])


def test_a_direction_is_that_of_the_x_axis() -> None:
    env = AlohaEnv("PutPenInCup", obs_type="state")
    env.reset(seed=FIRST_SEED)
    pose = env.object_pose("pen")
    x, y, angle = lying(pose)
    env.close()
    assert np.allclose(pose.point((0.1, 0.0, 0.0))[:2], [x + 0.1 * np.cos(angle), y + 0.1 * np.sin(angle)], atol=1e-3)


def test_scenes_are_for_key_poses_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["policy", "train", "--data", str(tmp_path), "--out", str(tmp_path / "p"), "--scenes", "5"]) == 2
    assert "give --kind key_pose" in capsys.readouterr().err
