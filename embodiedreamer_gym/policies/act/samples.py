"""Training examples drawn from episodes: the observation at a step, and the chunk of actions that followed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.image_size import scaled, scaled_masks
from embodiedreamer_gym.recordings.episodes import EpisodeSet

MEMORY = 4 << 30  # bytes of pictures kept; larger sets are read again whenever they are drawn
BLOCK = 64  # frames read at once
MASK_EVERY = 4  # least number of steps between two masks that are used for training
POSES_AT_ONCE = 16  # pictures; more do not fit into a CPU's cache
NEAR = 8  # steps: a step that is fewer steps after the start of a chunk is near it


class Sample(NamedTuple):
    """A batch for a policy, the actions (B, k, m) that followed, and padding (B, k): True past an episode's end."""

    batch: dict[str, Any]
    actions: np.ndarray
    padding: np.ndarray


def picture_size(episodes: EpisodeSet, camera: str) -> tuple[int, int]:
    """Width and height of a camera's pictures.

    Raises: PolicyError for an empty set, or a camera it does not have.
    """
    check_cameras(episodes, (camera,))
    height, width = episodes.frames(0, camera, 0, 1).shape[1:3]
    return int(width), int(height)


def check_cameras(episodes: EpisodeSet, cameras: tuple[str, ...]) -> None:
    """Check that there are episodes with these cameras.

    Raises: PolicyError if there are none.
    """
    if not len(episodes) or not sum(episodes.lengths):
        raise PolicyError("there is no episode to learn from; record some, for example with `embodiedreamer demos`.")
    for camera in cameras:
        if camera not in episodes.cameras:
            names = ", ".join(episodes.cameras) or "none"
            raise PolicyError(f"the episodes have no pictures of the camera '{camera}'; cameras: {names}.")


class Samples:
    """Checked episodes from which examples are drawn; the pictures are kept in memory if they fit.

    memory: bytes of pictures that may be kept.
    Raises: PolicyError for an empty set, a wrong state or action size, a number that is not finite or missing pictures.
    """

    def __init__(self, episodes: EpisodeSet, config: ActConfig, memory: int = MEMORY) -> None:
        check_cameras(episodes, config.cameras)
        self.config, self._episodes, self._memory = config, episodes, memory
        self.states = [self._checked(i, "state", episodes.states(i), config.state_size) for i in range(len(episodes))]
        self.actions = [
            self._checked(i, "action", episodes.actions(i), config.action_size) for i in range(len(episodes))
        ]
        self._ends = np.cumsum(episodes.lengths)
        width, height = config.image_size
        size = int(self._ends[-1]) * len(config.cameras) * width * height * 3
        self._kept: dict[tuple[int, str], np.ndarray] = {}
        self._object_poses: torch.Tensor | None = None
        steps = np.concatenate([np.arange(length) for length in episodes.lengths])
        self._chunk_starts = np.flatnonzero(steps % config.chunk < NEAR)
        if size <= memory and config.kind == "act":  # kind object_pose keeps the object poses instead
            self._kept = {
                (i, camera): self._read(i, camera, 0, episodes.lengths[i])
                for i in range(len(episodes)) for camera in config.cameras
            }  # fmt: skip

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __repr__(self) -> str:
        kept = "in memory" if self._kept else "read when drawn"
        return f"Samples({len(self)} steps of {len(self.states)} episodes, pictures {kept})"

    @property
    def fingerprint(self) -> list[list[Any]]:
        """Identifies this set: each episode's name, its length, and its sums of absolute states and actions."""
        states, actions = (
            [float(np.abs(one, dtype=np.float64).sum()) for one in part] for part in (self.states, self.actions)
        )
        return [list(row) for row in zip(self._episodes.names, self._episodes.lengths, states, actions, strict=True)]

    def draw(self, rng: np.random.Generator, count: int, chunk_start_share: float = 0.0) -> Sample:
        """Draw `count` examples; each step of each episode is equally likely.

        chunk_start_share: share of examples near chunk starts, where a policy that plays whole chunks predicts.
        """
        anywhere, near = rng.integers(len(self), size=count), rng.integers(len(self._chunk_starts), size=count)
        return self.at(np.where(rng.random(count) < chunk_start_share, self._chunk_starts[near], anywhere))

    def at(self, steps: np.ndarray) -> Sample:
        """The examples at these steps, which are numbered through all episodes."""
        which = np.searchsorted(self._ends, steps, side="right")
        starts = steps - (self._ends[which] - np.array(self._episodes.lengths)[which])
        ahead = starts[:, None] + np.arange(self.config.chunk)
        last = np.array(self._episodes.lengths)[which, None] - 1
        actions = [self.actions[i][row] for i, row in zip(which, np.minimum(ahead, last), strict=True)]
        states = np.stack([self.states[i][s] for i, s in zip(which, starts, strict=True)])
        batch: dict[str, Any] = {"agent_pos": states}
        if self._object_poses is not None:
            batch["object_poses"] = self._object_poses[steps]
            if self.config.kind == "object_pose":
                return Sample(batch, np.stack(actions), ahead > last)
        batch["pixels"] = {
            camera: np.stack([self._picture(int(i), camera, int(s)) for i, s in zip(which, starts, strict=True)])
            for camera in self.config.cameras
        }
        return Sample(batch, np.stack(actions), ahead > last)

    def keep_object_poses(
        self, poses: Callable[[Mapping[str, np.ndarray]], torch.Tensor], progress: ProgressCallback | None = None
    ) -> None:
        """Compute and keep the objects' poses of each step; poses: {camera: pictures (B, H, W, 3)} -> (B, numbers)."""
        rows, shown = [], progress_or_silence(progress)
        for i, length in enumerate(self._episodes.lengths):
            for at in range(0, length, POSES_AT_ONCE):
                until = min(at + POSES_AT_ONCE, length)
                rows.append(poses({camera: self._read(i, camera, at, until) for camera in self.config.cameras}).cpu())
            shown("object poses", i + 1, len(self._episodes))
        self._object_poses = torch.cat(rows)

    @property
    def has_object_poses(self) -> bool:
        """Whether the objects' poses are kept."""
        return self._object_poses is not None

    def masked_pictures(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        """Pictures (N, H, W, 3) of every fourth step, and their masks (N, H, W), which number the objects from 1.

        If these pictures would not fit into memory, fewer steps are used.
        """
        width, height = self.config.image_size
        every = max(MASK_EVERY, -(-len(self) * width * height * 4 // self._memory))
        numbers = np.zeros(256, np.uint8)
        for place, name in enumerate(self.config.objects, 1):
            numbers[self._episodes.objects[name]] = place
        steps = [(i, step) for i, length in enumerate(self._episodes.lengths) for step in range(0, length, every)]
        masks = [scaled_masks(self._episodes.masks(i, camera, step, step + 1), self.config.image_size)[0]
                 for i, step in steps]  # fmt: skip
        return np.stack([self._picture(i, camera, step) for i, step in steps]), numbers[np.stack(masks)]

    def _picture(self, i: int, camera: str, step: int) -> np.ndarray:
        if self._kept:
            return self._kept[i, camera][step]
        return self._read(i, camera, step, step + 1)[0]

    def _read(self, i: int, camera: str, start: int, stop: int) -> np.ndarray:
        """Pictures (stop - start, H, W, 3), scaled to the policy's size."""
        pictures = np.empty((stop - start, *self.config.image_size[::-1], 3), np.uint8)
        for at in range(start, stop, BLOCK):
            until = min(at + BLOCK, stop)
            frames = self._episodes.frames(i, camera, at, until)
            if len(frames) != until - at:
                raise PolicyError(
                    f"episode {self._episodes.names[i]} lacks pictures of the camera '{camera}' from step {at} on; "
                    "leave it out, or record it again."
                )
            pictures[at - start : until - start] = scaled(frames, self.config.image_size)
        return pictures

    def _checked(self, i: int, what: str, values: np.ndarray, size: int) -> np.ndarray:
        name = self._episodes.names[i]
        if values.shape != (self._episodes.lengths[i], size):
            raise PolicyError(
                f"episode {name}: {what}s have the shape {values.shape}, but the policy needs {size} numbers in each "
                f"of {self._episodes.lengths[i]} steps."
            )
        bad = np.flatnonzero(~np.isfinite(values).all(1))
        if len(bad):
            raise PolicyError(f"episode {name}: the {what} at step {bad[0]} is not finite; leave the episode out.")
        return values.astype(np.float32)
