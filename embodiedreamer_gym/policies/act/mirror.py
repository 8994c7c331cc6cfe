"""Demonstrations with their mirror images, in which the other arm does the same on the other side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.recordings.episodes import EpisodeSet


class MirroredEpisodes(EpisodeSet):
    """Episodes, followed by the mirror image of each, for a robot with arms and cameras symmetric about a plane.

    numbers (n,): signed joint numbers, counted from 1, from `embodiedreamer_gym.robot.mirror.mirrored_joints`; states
    and actions must have these joints. A camera that looks along the plane gets its own picture flipped; left_NAME gets
    the flipped picture of right_NAME. cameras: names of the cameras to use.
    Raises: PolicyError for numbers that describe no mirror or other joints, or for a camera without its counterpart.
    """

    def __init__(self, episodes: EpisodeSet, numbers: Sequence[int], cameras: Sequence[str]) -> None:
        signed = np.array(numbers, int)
        self._index, self._sign = np.abs(signed) - 1, np.sign(signed).astype(np.float32)
        count = np.arange(len(signed))
        if sorted(self._index) != list(count) or (self._index[self._index] != count).any():
            raise PolicyError(
                f"{list(numbers)} does not describe a mirror: mirroring a joint twice must give the same joint."
            )
        if not len(signed) == episodes.state_size == episodes.action_size:
            raise PolicyError(f"the mirror has {len(signed)} joints, but the episodes have states of "
                              f"{episodes.state_size} numbers and actions of {episodes.action_size}.")  # fmt: skip
        self._other = {name: _counterpart(name) for name in cameras}
        for name, other in self._other.items():
            if other not in cameras:
                raise PolicyError(
                    f"the camera '{name}' cannot be mirrored without '{other}'; use both cameras, or no mirror."
                )
        self._episodes, self.cameras = episodes, tuple(cameras)
        self.state_size, self.action_size = episodes.state_size, episodes.action_size
        self.lengths = tuple(episodes.lengths) * 2
        self.names = (*episodes.names, *(f"{name} in the mirror" for name in episodes.names))
        self.objects, self.source = getattr(episodes, "objects", {}), "the mirrored set"

    @property
    def hz(self) -> float:
        """Steps per second, Hz."""
        return self._episodes.hz

    def task(self, episode: int) -> str:
        """The task in words; "" where the files do not state it."""
        return self._episodes.task(episode % len(self._episodes))

    def frame_size(self, camera: str) -> tuple[int, int]:
        """Width and height of a camera's frames, pixels."""
        return self._episodes.frame_size(camera)

    def states(self, episode: int) -> np.ndarray:
        """States (T, n) of an episode."""
        return self._joints(episode, self._episodes.states(episode % len(self._episodes)))

    def actions(self, episode: int) -> np.ndarray:
        """Actions (T, m) of an episode."""
        return self._joints(episode, self._episodes.actions(episode % len(self._episodes)))

    def frames(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Pictures (stop - start, H, W, 3) uint8 of an episode, flipped for a mirror image."""
        return self._pictures(self._episodes.frames, episode, camera, start, stop)

    def masks(self, episode: int, camera: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Masks (stop - start, H, W) uint8 of the pictures."""
        return self._pictures(self._episodes.masks, episode, camera, start, stop)

    def _pictures(self, read: Callable[..., np.ndarray], episode: int, camera: str, *steps: int | None) -> np.ndarray:
        """Frames or masks of an episode; for a mirror image, those of the counterpart camera, flipped."""
        mirrored, episode = divmod(episode, len(self._episodes))
        if not mirrored:
            return read(episode, camera, *steps)
        return read(episode, self._other[camera], *steps)[:, :, ::-1]

    def _joints(self, episode: int, values: np.ndarray) -> np.ndarray:
        """Values (T, n) of the robot, or of the mirrored one."""
        return values if episode < len(self._episodes) else values[:, self._index] * self._sign


def _counterpart(name: str) -> str:
    for one, other in (("left", "right"), ("right", "left")):
        if one in name:
            return name.replace(one, other)
    return name
