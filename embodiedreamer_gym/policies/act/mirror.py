"""Demonstrations and what they are in a mirror: the other arm does the same on the other side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.samples import Episodes


class MirroredEpisodes:
    """A set of episodes, and after them the mirror image of each, for a rig whose arms and cameras are symmetric in a plane.

    numbers (n,): joint numbers, counted from 1, with a sign, as `embodiedreamer_gym.robot.mirror.mirrored_joints` gives
    them; states and actions are of the same joints. A camera that looks along the plane sees its own picture flipped, and
    left_NAME sees that of right_NAME. cameras: those that are looked through.
    Raises: PolicyError for numbers that are no mirror or of other joints, or cameras without their counterpart.
    """

    def __init__(self, episodes: Episodes, numbers: Sequence[int], cameras: Sequence[str]) -> None:
        found = np.array(numbers, int)
        self._index, self._sign = np.abs(found) - 1, np.sign(found).astype(np.float32)
        count = np.arange(len(found))
        if sorted(self._index) != list(count) or (self._index[self._index] != count).any():
            raise PolicyError(f"{list(numbers)} is no mirror: each joint is the image of its own image.")
        if not len(found) == episodes.state_size == episodes.action_size:
            raise PolicyError(f"the mirror is of {len(found)} joints, and the episodes have states of "
                              f"{episodes.state_size} numbers, actions of {episodes.action_size}.")  # fmt: skip
        self._other = {name: _counterpart(name) for name in cameras}
        for name, other in self._other.items():
            if other not in cameras:
                raise PolicyError(f"the camera '{name}' cannot be mirrored without '{other}'; take both, or no mirror.")
        self._episodes, self.cameras = episodes, tuple(cameras)
        self.state_size, self.action_size = episodes.state_size, episodes.action_size
        self.lengths = tuple(episodes.lengths) * 2
        self.names = (*episodes.names, *(f"{name} in the mirror" for name in episodes.names))

    def __len__(self) -> int:
        return 2 * len(self._episodes)

    @property
    def hz(self) -> float:
        """Steps per second, Hz."""
        return self._episodes.hz

    @property
    def objects(self) -> Mapping[str, int]:
        """Of each object, its number in the masks; none without masks."""
        return getattr(self._episodes, "objects", {})

    def states(self, i: int, /) -> np.ndarray:
        """States (T, n) of an episode."""
        return self._joints(i, self._episodes.states(i % len(self._episodes)))

    def actions(self, i: int, /) -> np.ndarray:
        """Actions (T, m) of an episode."""
        return self._joints(i, self._episodes.actions(i % len(self._episodes)))

    def frames(self, i: int, camera: str, start: int, stop: int, /) -> np.ndarray:
        """Pictures (stop - start, H, W, 3) uint8 of an episode."""
        turned, i = divmod(i, len(self._episodes))
        if not turned:
            return self._episodes.frames(i, camera, start, stop)
        return self._episodes.frames(i, self._other[camera], start, stop)[:, :, ::-1]

    def masks(self, i: int, camera: str, start: int, stop: int, /) -> np.ndarray:
        """Masks (stop - start, H, W) uint8 of the pictures."""
        turned, i = divmod(i, len(self._episodes))
        if not turned:
            return self._episodes.masks(i, camera, start, stop)
        return self._episodes.masks(i, self._other[camera], start, stop)[:, :, ::-1]

    def _joints(self, i: int, values: np.ndarray) -> np.ndarray:
        """Values (T, n) of the robot, or of the mirrored one."""
        return values if i < len(self._episodes) else values[:, self._index] * self._sign


def _counterpart(name: str) -> str:
    for one, other in (("left", "right"), ("right", "left")):
        if one in name:
            return name.replace(one, other)
    return name
