"""Frames of several environments, generated chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import gymnasium as gym
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import Aligner, Bank, Condition, References
from embodiedreamer_gym.vis_aligner.bank import Entry

GRAIN_SEED = 1  # combined with the seed of a reset


class GeneratedFrames:
    """Generated frames of n environments, chunk by chunk; `references` holds the reference frames of each next chunk.

    grain: whether to add the sensor's noise to the frames that are shown; references stay without it.
    Raises: VisionError if grain is requested and the bank does not know it.
    """

    def __init__(self, aligner: Aligner, moving_aligner: Aligner, bank: Bank, count: int, grain: bool = False) -> None:
        self.aligner, self.moving_aligner, self.bank = aligner, moving_aligner, bank
        self.references: list[References | None] = [None] * count
        self.shown: list[np.ndarray | None] = [None] * count
        known = None if bank.bench is None else bank.bench.grain
        if grain and known is None:
            raise VisionError(
                "the bank does not contain the grain of its sensor; make it again with `embodiedreamer vis bank`."
            )
        self._grain = float(known or 0.0) if grain else 0.0
        self._rngs = [np.random.default_rng() for _ in range(count)]

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Seed the grain of each environment; None leaves it as it is."""
        for i, seed in enumerate(seeds):
            if seed is not None:
                self._rngs[i] = np.random.default_rng([seed, GRAIN_SEED])

    def begin(
        self, views: Sequence[Condition], entry: Entry | None, edit: Callable[[References], References] | None = None
    ) -> np.ndarray:
        """Start an episode in each environment; return first frames (n, F, H, W, 3).

        The first frame of each environment is repeated for all F frames of its view.
        """
        starts = [self.bank.start(view, entry) for view in views]
        self.references = [one if edit is None else edit(one) for one in starts]
        return self._as_seen(
            [np.repeat(self.last(i)[None], len(view), axis=0) for i, view in enumerate(views)], [0] * len(views)
        )

    def render(self, views: Sequence[Condition], counts: Sequence[int]) -> np.ndarray:
        """Generate the F frames of each view, (n, F, H, W, 3), in pieces of the length the aligner was trained on.

        counts: number of new frames of each view; later ones repeat the last. With 0, the environment has been reset.
        """
        frames = [np.repeat(self.last(i)[None], len(view), axis=0) for i, view in enumerate(views)]
        for i, count in enumerate(counts):
            if count == 0:
                self.references[i] = self.bank.start(views[i])
                frames[i][:] = self.last(i)
        aligner = self.moving_aligner if views[0].moving_camera else self.aligner
        for start in range(0, int(max(counts, default=0)), aligner.chunk):
            going = [i for i, count in enumerate(counts) if count > start]
            references = [self._reference(i) for i in going]
            parts = [r.lit(views[i].part(start, start + aligner.chunk)) for i, r in zip(going, references, strict=True)]
            clips = aligner.render(references, parts)
            for i, reference, part, clip in zip(going, references, parts, clips, strict=True):
                count = min(int(counts[i]) - start, len(part))
                self.references[i] = reference.after(clip[:count], part.part(0, count))
                frames[i][start : start + count] = clip[:count]
                frames[i][start + count :] = clip[count - 1]
        return self._as_seen(frames, counts)

    def _as_seen(self, frames: Sequence[np.ndarray], counts: Sequence[int]) -> np.ndarray:
        """The frames (n, F, H, W, 3) with grain; a repeated frame has the same grain."""
        seen = np.stack(frames)
        for i, (clip, count) in enumerate(zip(seen, counts, strict=True)):
            new = max(int(count), 1)
            if self._grain:
                grainy = clip[:new] + self._rngs[i].normal(0.0, self._grain, clip[:new].shape)
                clip[:new] = np.clip(np.round(grainy), 0, 255).astype(np.uint8)
                clip[new:] = clip[new - 1]
            self.shown[i] = clip[-1]
        return seen

    def last(self, i: int) -> np.ndarray:
        """Return the last frame (H, W, 3) of an environment."""
        return self._reference(i).last

    def _reference(self, i: int) -> References:
        reference = self.references[i]
        if reference is None:
            raise gym.error.ResetNeeded("call reset before the first step.")
        return reference
