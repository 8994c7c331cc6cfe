"""The lean model as an aligner: batches in, frames out, and the loss that it is trained by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from torch import Generator, Tensor

from embodiedreamer_gym.vis_aligner.aligner import check_batch
from embodiedreamer_gym.vis_aligner.channels import (
    background,
    frame_channels,
    reference_channels,
    stale,
    to_frames,
    to_tensor,
)
from embodiedreamer_gym.vis_aligner.clip import ROBOT, Condition, References, Window
from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample
from embodiedreamer_gym.vis_aligner.lean import Lean
from embodiedreamer_gym.vis_aligner.window import windows

THINGS = 4.0  # weight of a pixel of robot or object, beside 1
EDGES = 0.5  # weight of the pictures' gradients
WHOLE = (slice(None), slice(None))
ROUND = 0.01  # below which an error counts squared (of 2 from black to white)


class LeanAligner:
    """A lean network; chunk: frames it was trained on; steps: of diffusion; seed: of its noise, the same for every chunk."""

    def __init__(self, network: Lean, chunk: int = 8, steps: int = 1, seed: int = 0, name: str = "lean") -> None:
        self.network, self.inputs = network, network.config.inputs
        self.chunk, self.steps, self.seed, self.name = chunk, steps, seed, name

    def __repr__(self) -> str:
        return f"LeanAligner({self.name!r}, {self.chunk} frames, {self.steps} steps)"

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames, a batch at once.

        Raises: VisionError when sizes or lengths differ.
        """
        check_batch(references, conditions)
        still = [background(r, c, self.inputs) for r, c in zip(references, conditions, strict=True)]
        out = [to_frames(clip).copy() for clip in still]
        places = windows(references, conditions) if self.network.config.gate else [WHOLE] * len(out)
        if places is None:
            return out
        frame, clip, base, old = self._stack(references, conditions, still, places)
        noise = torch.randn(base.shape[1:], generator=Generator().manual_seed(self.seed)).expand_as(base)
        training = self.network.training
        self.network.eval()
        with torch.inference_mode():
            made = sample(lambda x, time: self.network(x, time, frame, clip, base, old), noise, self.steps)
        self.network.train(training)
        for whole, part, (rows, columns) in zip(out, to_frames(made), places, strict=True):
            whole[:, rows, columns] = part
        return out

    def loss(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
             generator: Generator) -> Tensor:  # fmt: skip
        """Charbonnier loss of pixels and of their differences, things weighing more, at drawn noise levels."""
        still = [background(r, c, self.inputs) for r, c in zip(references, conditions, strict=True)]
        places = windows(references, conditions) or [WHOLE] * len(truth)
        frame, clip, base, old = self._stack(references, conditions, still, places)
        true = torch.stack([to_tensor(t[:, rows, columns]) for t, (rows, columns) in zip(truth, places, strict=True)])
        time = draw_times(len(true), generator)
        made = self.network(
            add_noise(true, time, torch.randn(true.shape, generator=generator)), time, frame, clip, base, old
        )
        classes = [c.crop(place).classes for c, place in zip(conditions, places, strict=True)]
        thing = torch.from_numpy(np.stack(classes) >= ROBOT).float()
        weight = F.max_pool2d(1 + (THINGS - 1) * thing, 3, 1, 1)[:, :, None]  # and their edges
        weight, error = weight / weight.mean(), made - true
        across, down = error.diff(dim=-1), error.diff(dim=-2)
        edges = _size(across, weight[..., 1:]) + _size(down, weight[..., 1:, :])
        return _size(error, weight) + EDGES * edges

    def _stack(
        self, references: Sequence[References], conditions: Sequence[Condition], still: Sequence[Tensor],
        places: Sequence[Window],
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
        """Windows of conditions (B, T, C, h, w), references (B, R, h, w), still frames (B, T, 3, h, w), and what is stale."""
        width = conditions[0].size[0]
        frame = [frame_channels(c.crop(w), self.inputs, width) for c, w in zip(conditions, places, strict=True)]
        clip = [reference_channels(r.crop(w), self.inputs, width) for r, w in zip(references, places, strict=True)]
        base = [s[..., rows, columns] for s, (rows, columns) in zip(still, places, strict=True)]
        old = [stale(r.crop(w), c.crop(w)) for r, c, w in zip(references, conditions, places, strict=True)]
        return torch.stack(frame), torch.stack(clip), torch.stack(base), torch.stack(old)


def _size(error: Tensor, weight: Tensor) -> Tensor:
    return (weight * torch.sqrt(error**2 + ROUND**2)).mean()
