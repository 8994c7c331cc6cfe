"""The lean model as an aligner: rendering of batches, and the training loss."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F
from torch import Generator, Tensor

from embodiedreamer_gym.vis_aligner.aligner import Made, check_batch
from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import ROBOT, WHOLE, Condition, Window
from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample
from embodiedreamer_gym.vis_aligner.lean import Lean
from embodiedreamer_gym.vis_aligner.light import carried_light
from embodiedreamer_gym.vis_aligner.motion_window import windows
from embodiedreamer_gym.vis_aligner.network_inputs import (
    allowed,
    frame_channels,
    reference_channels,
    reprojected_pixels,
    to_frames,
    to_tensor,
)

THINGS = 4.0  # weight of a pixel of robot or object; others have 1
EDGES = 0.5  # weight of the loss of the pictures' gradients
ROUND = 0.01  # Charbonnier constant: smaller errors count as squares (black to white is 2)


class LeanAligner:
    """A lean network as an aligner.

    chunk: number of frames of a clip in training; steps: of diffusion; seed: of the noise, which is the same for every
    chunk.
    """

    learning_rate = 1e-3  # of AdamW, from untrained weights

    def __init__(self, network: Lean, chunk: int = 8, steps: int = 1, seed: int = 0, name: str = "lean") -> None:
        self.network, self.inputs = network, network.config.inputs
        self.chunk, self.steps, self.seed, self.name = chunk, steps, seed, name

    def __repr__(self) -> str:
        return f"LeanAligner({self.name!r}, {self.chunk} frames, {self.steps} steps)"

    @property
    def device(self) -> torch.device:
        """The network's device."""
        return self.network.out.weight.device

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames, as one batch.

        Raises: VisionError when sizes or lengths differ.
        """
        check_batch(references, conditions)
        references, conditions = self._allowed(references, conditions)
        places = windows(references, conditions) if self.network.config.gate else [WHOLE] * len(conditions)
        if places is None:
            return _lasting(references, conditions)
        given = self._stack(references, conditions, places)
        return _pasted(_lasting(references, conditions), self._sampled(given), places)

    def _sampled(self, given: tuple[Tensor, ...]) -> Tensor:
        """The generated clips (B, T, 3, H, W) in their windows."""
        noise = torch.randn(given[2].shape[1:], generator=Generator().manual_seed(self.seed))
        noise = noise.to(given[2].device).expand_as(given[2])
        training = self.network.training
        self.network.eval()
        with torch.inference_mode():
            made = sample(lambda x, time: self.network(x, time, *given), noise, self.steps)
        self.network.train(training)
        return made

    def attempt(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
                generator: Generator) -> tuple[Tensor, Made]:  # fmt: skip
        """Loss at drawn noise levels, and the generated frames.

        The loss is Charbonnier, over pixels and over their gradients, with a larger weight on robot and objects.
        """
        references, conditions = self._allowed(references, conditions)
        places = windows(references, conditions) or [WHOLE] * len(truth)
        given = self._stack(references, conditions, places)
        true = torch.stack([to_tensor(t[:, rows, columns]) for t, (rows, columns) in zip(truth, places, strict=True)])
        time = draw_times(len(true), generator).to(self.device)
        noise = torch.randn(true.shape, generator=generator).to(self.device)
        true = true.to(self.device)
        made = self.network(add_noise(true, time, noise), time, *given)
        classes = [c.crop(place).classes for c, place in zip(conditions, places, strict=True)]
        thing = torch.from_numpy(np.stack(classes) >= ROBOT).float().to(self.device)
        weight = F.max_pool2d(1 + (THINGS - 1) * thing, 3, 1, 1)[:, :, None]  # and their edges
        weight, error = weight / weight.mean(), made - true
        across, down = error.diff(dim=-1), error.diff(dim=-2)
        edges = _size(across, weight[..., 1:]) + _size(down, weight[..., 1:, :])
        loss = _size(error, weight) + EDGES * edges
        return loss, lambda: _pasted(_lasting(references, conditions), made.detach(), places)

    def _allowed(
        self, references: Sequence[References], conditions: Sequence[Condition]
    ) -> tuple[list[References], list[Condition]]:
        """References and conditions reduced to the network's inputs, with shade if the light is known."""
        see = partial(allowed, inputs=self.inputs)
        lit = [r.lit(c) for r, c in zip(references, conditions, strict=True)]
        return [r.viewed(see) for r in references], [see(c) for c in lit]

    def _stack(
        self, references: Sequence[References], conditions: Sequence[Condition], places: Sequence[Window]
    ) -> tuple[Tensor, ...]:
        """The network's inputs besides noise and time, in windows: conditions, references, still, sources, stale."""
        width = conditions[0].size[0]
        views = [c.crop(w) for c, w in zip(conditions, places, strict=True)]
        start = [r.crop(w) for r, w in zip(references, places, strict=True)]
        frame = [frame_channels(view, self.inputs, width) for view in views]
        clip = [reference_channels(one, self.inputs, width) for one in start]
        made = [reprojected_pixels(r, v, self.inputs) for r, v in zip(start, views, strict=True)]
        parts = (frame, clip, *([getattr(one, key) for one in made] for key in ("still", "sources", "stale")))
        return tuple(torch.stack(part).to(self.device) for part in parts)


def _lasting(references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
    """The last frame of each, repeated for its clip, with moving shadows: outside the windows, nothing else changes."""
    return [carried_light(r.last, r.last_condition, c) for r, c in zip(references, conditions, strict=True)]


def _pasted(whole: list[np.ndarray], clips: Tensor, places: Sequence[Window]) -> list[np.ndarray]:
    """The frames with the clips pasted into their windows."""
    for frames, part, (rows, columns) in zip(whole, to_frames(clips), places, strict=True):
        frames[:, rows, columns] = part
    return whole


def _size(error: Tensor, weight: Tensor) -> Tensor:
    return (weight * torch.sqrt(error**2 + ROUND**2)).mean()
