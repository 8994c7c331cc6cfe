"""The mirror image of demonstrations."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.mirror import Mirror
from embodiedreamer_gym.policies.act.samples import Sample

NUMBERS = (-3, 4, -1, 2)  # two arms of a turning and a lifting joint


def sample() -> Sample:
    rng = np.random.default_rng(0)
    pixels = {name: rng.integers(0, 255, (3, 4, 6, 3), np.uint8) for name in ("head", "left_wrist", "right_wrist")}
    states = np.arange(12, dtype=np.float32).reshape(3, 4)
    actions = np.arange(24, dtype=np.float32).reshape(3, 2, 4)
    return Sample({"agent_pos": states, "pixels": pixels}, actions, np.zeros((3, 2), bool))


def test_arms_change_places_and_pictures_are_flipped() -> None:
    before, mirror = sample(), Mirror(NUMBERS, ("head", "left_wrist", "right_wrist"))
    which = np.array([True, False, True])
    after = mirror(before, which)
    assert after.batch["agent_pos"][0].tolist() == [-2.0, 3.0, -0.0, 1.0]
    assert after.batch["agent_pos"][1].tolist() == before.batch["agent_pos"][1].tolist()
    assert after.actions[2, 1].tolist() == [-22.0, 23.0, -20.0, 21.0]
    seen, told = before.batch["pixels"], after.batch["pixels"]
    assert np.array_equal(told["head"][0], seen["head"][0, :, ::-1]) and np.array_equal(
        told["head"][1], seen["head"][1]
    )
    assert np.array_equal(told["left_wrist"][2], seen["right_wrist"][2, :, ::-1])
    assert np.array_equal(told["right_wrist"][2], seen["left_wrist"][2, :, ::-1])


def test_twice_is_once() -> None:
    before, mirror = sample(), Mirror(NUMBERS, ("head", "left_wrist", "right_wrist"))
    again = mirror(mirror(before, np.ones(3, bool)), np.ones(3, bool))
    assert np.array_equal(again.actions, before.actions)
    assert np.array_equal(again.batch["agent_pos"], before.batch["agent_pos"])
    for name, pictures in before.batch["pixels"].items():
        assert np.array_equal(again.batch["pixels"][name], pictures)


@pytest.mark.parametrize("numbers", [(2, 3, 1), (1, 1), (0, 2), (5, 1)])
def test_what_is_no_mirror(numbers: tuple[int, ...]) -> None:
    with pytest.raises(PolicyError, match="is no mirror"):
        Mirror(numbers, ("head",))


def test_a_wrist_without_the_other() -> None:
    with pytest.raises(PolicyError, match="'left_wrist' cannot be mirrored without 'right_wrist'"):
        Mirror(NUMBERS, ("head", "left_wrist"))
