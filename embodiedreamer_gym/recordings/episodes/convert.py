"""Episodes from one format to another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np

from embodiedreamer_gym.recordings.episodes.episode_set import EpisodeSet

READ_FRAMES = 16  # frames that are read at a time


class EpisodeWriter(Protocol):
    """What AlohaWriter and LeRobotWriter have in common."""

    def add_episode(self, states: np.ndarray, actions: np.ndarray, frames: Any, task: str = "", **extras: Any) -> None:
        """Write one episode."""
        ...


def copy_episodes(
    source: EpisodeSet, writer: EpisodeWriter, task: str | None = None, count: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:  # fmt: skip
    """Write the episodes of a set, or the first so many, a few frames at a time.

    task: in place of the set's own; progress: called with their number so far.
    Raises: RecordingError where an episode cannot be read or written.
    """
    for number in range(len(source) if count is None else count):
        writer.add_episode(
            source.states(number),
            source.actions(number),
            {camera: frames_of(source, number, camera) for camera in source.cameras},
            source.task(number) if task is None else task,
        )
        if progress is not None:
            progress(number + 1)


def frames_of(source: EpisodeSet, episode: int, camera: str) -> Iterator[np.ndarray]:
    """The frames of an episode, one after another."""
    length = source.lengths[episode]
    for start in range(0, length, READ_FRAMES):
        yield from source.frames(episode, camera, start, min(start + READ_FRAMES, length))
