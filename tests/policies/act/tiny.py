"""A tiny set of episodes: a bright square in the picture says where the action is to go."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.policies.act import ActConfig

SIZE = (32, 24)
CONFIG = ActConfig(3, 2, ("head",), SIZE, chunk=4, widths=(8, 8), width=16, heads=2, feedforward=16, encoders=1)


class Tiny:
    """Episodes of an arm whose first action is the square's column, the second ramps up with time."""

    hz = 30.0

    def __init__(self, lengths=(7, 5, 9), cameras=("head",), size=SIZE, seed=0) -> None:
        rng = np.random.default_rng(seed)
        self.lengths, self.cameras, self.size = tuple(lengths), tuple(cameras), size
        self.names = tuple(f"episode_{i}" for i in range(len(self.lengths)))
        self.state_size, self.action_size = 3, 2
        self.columns = rng.uniform(0.1, 0.9, len(self.lengths))
        self._states = [rng.normal(size=(t, 3)).astype(np.float32) for t in self.lengths]
        self._actions = [
            np.stack([np.full(t, x), np.arange(t) / 10], 1).astype(np.float32)
            for t, x in zip(self.lengths, self.columns, strict=True)
        ]
        self.missing = 0  # frames at the end of each episode
        self.read: list[int] = []  # how many frames each call asked for

    def __len__(self) -> int:
        return len(self.lengths)

    def states(self, i: int) -> np.ndarray:
        return self._states[i].copy()

    def actions(self, i: int) -> np.ndarray:
        return self._actions[i]

    def frames(self, i: int, camera: str, start: int, stop: int) -> np.ndarray:
        self.read.append(stop - start)
        width, height = self.size
        column = int(self.columns[i] * (width - 4))
        frames = np.full((stop - start, height, width, 3), 10 * self.cameras.index(camera), np.uint8)
        frames[:, height // 3 : 2 * height // 3, column : column + 4] = 250
        frames[:, 0, 0, 0] = np.arange(start, stop)  # tells a frame from the next
        return frames[: max(0, self.lengths[i] - self.missing - start)]
