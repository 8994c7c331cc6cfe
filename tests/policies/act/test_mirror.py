"""Episodes and what they are in a mirror."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.mirror import MirroredEpisodes
from tests.policies.act.tiny import Tiny

NUMBERS = (-3, 4, -1, 2)  # two arms of a turning and a lifting joint
CAMERAS = ("head", "left_wrist", "right_wrist")


class TwoArms(Tiny):
    """Two arms, three cameras; noise in place of pictures."""

    objects = {"cup": 3}

    def __init__(self) -> None:
        super().__init__(lengths=(3, 4), cameras=CAMERAS, size=(6, 4))
        self.state_size = self.action_size = 4

    def states(self, i: int) -> np.ndarray:
        return np.arange(4 * self.lengths[i], dtype=np.float32).reshape(-1, 4) + i

    def actions(self, i: int) -> np.ndarray:
        return 10.0 + self.states(i)

    def frames(self, i: int, camera: str, start: int, stop: int) -> np.ndarray:
        rng = np.random.default_rng([i, CAMERAS.index(camera)])
        return rng.integers(0, 255, (self.lengths[i], 4, 6, 3), np.uint8)[start:stop]

    def masks(self, i: int, camera: str, start: int, stop: int) -> np.ndarray:
        return self.frames(i, camera, start, stop)[..., 0]


def test_arms_change_places_and_pictures_are_flipped() -> None:
    plain, both = TwoArms(), MirroredEpisodes(TwoArms(), NUMBERS, CAMERAS)
    assert (len(both), both.lengths, both.hz, dict(both.objects)) == (4, (3, 4, 3, 4), 30.0, {"cup": 3})
    assert len(set(both.names)) == 4
    for i in range(2):
        assert np.array_equal(both.states(i), plain.states(i)) and np.array_equal(both.actions(i), plain.actions(i))
        assert np.array_equal(both.frames(i, "left_wrist", 1, 3), plain.frames(i, "left_wrist", 1, 3))
    assert both.states(2)[0].tolist() == [-2.0, 3.0, -0.0, 1.0]
    assert both.actions(3)[0].tolist() == [-13.0, 14.0, -11.0, 12.0]
    for name, other in (("head", "head"), ("left_wrist", "right_wrist"), ("right_wrist", "left_wrist")):
        assert np.array_equal(both.frames(3, name, 1, 3), plain.frames(1, other, 1, 3)[:, :, ::-1])
        assert np.array_equal(both.masks(3, name, 1, 3), plain.masks(1, other, 1, 3)[:, :, ::-1])


def test_twice_is_once() -> None:
    again = MirroredEpisodes(MirroredEpisodes(TwoArms(), NUMBERS, CAMERAS), NUMBERS, CAMERAS)
    assert np.array_equal(again.states(6), TwoArms().states(0))
    assert np.array_equal(again.actions(6), TwoArms().actions(0))
    for name in CAMERAS:
        assert np.array_equal(again.frames(6, name, 0, 2), TwoArms().frames(0, name, 0, 2))


@pytest.mark.parametrize("numbers", [(2, 3, 1), (1, 1), (0, 2), (5, 1)])
def test_what_is_no_mirror(numbers: tuple[int, ...]) -> None:
    with pytest.raises(PolicyError, match="does not describe a mirror"):
        MirroredEpisodes(TwoArms(), numbers, ("head",))


def test_a_mirror_of_other_joints() -> None:
    with pytest.raises(PolicyError, match="the mirror has 2 joints, but the episodes have states of 4 numbers"):
        MirroredEpisodes(TwoArms(), (-1, 2), ("head",))


def test_a_wrist_without_the_other() -> None:
    with pytest.raises(PolicyError, match="'left_wrist' cannot be mirrored without 'right_wrist'"):
        MirroredEpisodes(TwoArms(), NUMBERS, ("head", "left_wrist"))
