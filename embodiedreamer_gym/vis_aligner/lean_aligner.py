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
    to_frames,
    to_tensor,
)
from embodiedreamer_gym.vis_aligner.clip import ROBOT, Condition, References
from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample
from embodiedreamer_gym.vis_aligner.lean import Lean

THINGS = 4.0  # weight of a pixel of robot or object, beside 1
EDGES = 0.5  # weight of the pictures' gradients
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
        frame, clip, still = self._stack(references, conditions)
        noise = torch.randn(still.shape[1:], generator=Generator().manual_seed(self.seed)).expand_as(still)
        training = self.network.training
        self.network.eval()
        with torch.inference_mode():
            made = sample(lambda x, time: self.network(x, time, frame, clip, still), noise, self.steps)
        self.network.train(training)
        return list(to_frames(made))

    def loss(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
             generator: Generator) -> Tensor:  # fmt: skip
        """Charbonnier loss of pixels and of their differences, things weighing more, at drawn noise levels."""
        frame, clip, still = self._stack(references, conditions)
        true = torch.stack([to_tensor(t) for t in truth])
        time = draw_times(len(true), generator)
        made = self.network(
            add_noise(true, time, torch.randn(true.shape, generator=generator)), time, frame, clip, still
        )
        thing = torch.from_numpy(np.stack([c.classes for c in conditions]) >= ROBOT).float()
        weight = F.max_pool2d(1 + (THINGS - 1) * thing, 3, 1, 1)[:, :, None]  # and their edges
        weight, error = weight / weight.mean(), made - true
        across, down = error.diff(dim=-1), error.diff(dim=-2)
        edges = _size(across, weight[..., 1:]) + _size(down, weight[..., 1:, :])
        return _size(error, weight) + EDGES * edges

    def _stack(
        self, references: Sequence[References], conditions: Sequence[Condition]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Frames' conditions (B, T, C, H, W), references (B, R, H, W), and still (B, T, 3, H, W), see `Lean.forward`."""
        frame = torch.stack([frame_channels(c, self.inputs) for c in conditions])
        clip = torch.stack([reference_channels(r, self.inputs) for r in references])
        still = torch.stack([background(r, c, self.inputs) for r, c in zip(references, conditions, strict=True)])
        return frame, clip, still


def _size(error: Tensor, weight: Tensor) -> Tensor:
    return (weight * torch.sqrt(error**2 + ROUND**2)).mean()
