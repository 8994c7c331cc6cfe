"""Which joints are each other's mirror image."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel, mirror
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.robot.mirror import mirrored_joints


def test_a_mirrored_posture_is_seen_in_the_mirror() -> None:
    """Both tips are where the other's image is, in postures that were not used to find the signs."""
    model = RobotModel.load("aloha")
    numbers = np.array(mirrored_joints(model))
    assert sorted(abs(numbers)) == list(range(1, 15)) and numbers[6] == 14 and numbers[13] == 7
    left, right = (Kinematics(model, tip) for tip in model.arms)
    for angles in np.random.default_rng(5).uniform(-0.8, 0.8, (5, 14)):
        image = np.sign(numbers) * angles[np.abs(numbers) - 1]
        for one, other in ((left, right), (right, left)):
            at, turned = one.pose(angles[one.joints])
            seen, seen_turned = other.pose(image[other.joints])
            assert np.allclose(at * [1, -1, 1], seen, atol=1e-6)
            assert np.allclose(turned[:, 2] * [1, -1, 1], seen_turned[:, 2], atol=1e-6)


def test_what_has_no_mirror_image(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ModelError, match="so101 has 1 arms; only two"):
        mirrored_joints(RobotModel.load("so101"))
    monkeypatch.setattr(mirror, "PLANE", np.array([-1.0, 1.0, 1.0]))  # x = 0, which both arms are in front of
    with pytest.raises(ModelError, match="not each other's mirror image"):
        mirrored_joints(RobotModel.load("aloha"))
