"""The lean model: a small gated U-Net that generates pixels in one step, without a VAE."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs

PAIR = 2  # pixels per side of a cell of the finest level
DEEPEST = 16  # pixels per side of a cell of the coarsest level
LEVEL = 64  # size of the noise level's embedding
WIDEST = 1024  # channels
OPEN, SHUT = 0.9, 0.1  # values of the sigmoid from which on the gate is exactly 1 or 0; linear between


@dataclass(frozen=True)
class LeanConfig:
    """Sizes of the lean model.

    Raises: VisionError for widths that cannot be built.
    """

    widths: tuple[int, int, int, int] = (16, 32, 64, 96)
    """Channels at 1/2, 1/4, 1/8 and 1/16 of the picture, multiples of 8."""
    inputs: Inputs = field(default_factory=Inputs)
    """Inputs that the model uses."""
    gate: bool = True
    """Whether the model may keep pixels of other pictures; False generates every pixel."""

    def __post_init__(self) -> None:
        """Check."""
        good = all(isinstance(w, int) and 8 <= w <= WIDEST and w % 8 == 0 for w in self.widths)
        if not good or len(self.widths) != 4:
            raise VisionError(f"widths {self.widths} must be four multiples of 8, at most {WIDEST}.")


class Block(nn.Module):
    """Two convolutions with a residual connection; the noise level scales and shifts the features between them.

    over_time: whether a convolution over time follows.
    """

    def __init__(self, inside: int, outside: int, over_time: bool = False) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(8, inside)
        self.first = nn.Conv2d(inside, outside, 3, padding=1)
        self.level = nn.Linear(LEVEL, 2 * outside)
        self.second = nn.Conv2d(outside, outside, 3, padding=1)
        self.skip = nn.Conv2d(inside, outside, 1) if inside != outside else nn.Identity()
        self.time = nn.Conv2d(3 * outside, outside, 1) if over_time else None

    def forward(self, x: Tensor, level: Tensor, frames: int) -> Tensor:
        """Features (B T, C, h, w) of clips with T = frames; level (B, L)."""
        scale, shift = self.level(level).repeat_interleave(frames, 0)[..., None, None].chunk(2, 1)
        y = self.first(F.relu(self.norm(x)))
        y = self.second(F.relu_(y * (1 + scale) + shift)) + self.skip(x)
        if self.time is not None:  # a convolution over three frames
            clips = F.pad(y.unflatten(0, (-1, frames)), (0, 0, 0, 0, 0, 0, 1, 1))
            beside = torch.cat([clips[:, :-2], clips[:, 1:-1], clips[:, 2:]], 2).flatten(0, 1)
            y = y + self.time(F.relu_(beside))
        return y


class Lean(nn.Module):
    """The network: noisy clip, conditions, references -> clean clip; all inputs in -1 .. 1."""

    def __init__(self, config: LeanConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LeanConfig()
        fine, a, b, c = config.widths
        cell = PAIR * PAIR
        self.embed = nn.Sequential(nn.Linear(16, LEVEL), nn.SiLU(), nn.Linear(LEVEL, LEVEL))
        inside = 3 + 3 + 1 + 3 * config.inputs.sources + config.inputs.per_frame
        self.frame_in = nn.Conv2d(inside, fine, PAIR, stride=PAIR)
        self.clip_in = nn.Conv2d(config.inputs.per_clip, fine, PAIR, stride=PAIR)
        self.down0 = nn.Conv2d(fine, a, 2, stride=2)
        self.down1 = Block(a, a)
        self.down2 = Block(a, b, over_time=True)
        self.down3 = Block(b, c, over_time=True)
        self.middle = Block(c, c, over_time=True)
        self.up2 = Block(c + b, b, over_time=True)
        self.up1 = Block(b + a, a)
        self.up0 = nn.ConvTranspose2d(a, fine, 2, stride=2)
        self.detail = nn.Conv2d(2 * fine, fine, 3, padding=1)
        self.out = nn.Conv2d(fine, (4 + config.inputs.sources) * cell, 3, padding=1)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # pyright: ignore[reportArgumentType]

    def forward(self, noisy: Tensor, time: Tensor, frame: Tensor, clip: Tensor, still: Tensor, sources: Tensor,
                stale: Tensor) -> Tensor:  # fmt: skip
        """The clean clip (B, T, 3, H, W).

        noisy (B, T, 3, H, W); time (B,); frame (B, T, C, H, W): each frame's condition; clip (B, R, H, W): the
        references; still (B, T, 3, H, W): frames assembled from other pictures; sources (B, T, S, 3, H, W): the same,
        with one real picture first; stale (B, T, 1, H, W): 1 where no picture shows the pixel, which opens the gate.
        """
        frames, size = noisy.shape[1], noisy.shape[-2:]
        seen = torch.cat([noisy, frame, still, sources.flatten(2, 3), stale], 2).flatten(0, 1)
        pad = (0, -size[1] % DEEPEST, 0, -size[0] % DEEPEST)
        if any(pad):
            seen, clip = F.pad(seen, pad), F.pad(clip, pad)
        seen, clip = (x.contiguous(memory_format=torch.channels_last) for x in (seen, clip))  # a tenth faster
        level = self.embed(_waves(time))
        given = self.clip_in(clip).repeat_interleave(frames, 0)
        x0 = F.relu_(self.frame_in(seen) + given)
        x1 = self.down1(self.down0(x0), level, frames)
        x2 = self.down2(F.avg_pool2d(x1, 2), level, frames)
        x3 = self.middle(self.down3(F.avg_pool2d(x2, 2), level, frames), level, frames)
        y = self.up2(torch.cat([_twice(x3), x2], 1), level, frames)
        y = self.up1(torch.cat([_twice(y), x1], 1), level, frames)
        y = F.relu_(self.detail(torch.cat([F.relu_(self.up0(y)), x0], 1)))
        out = F.pixel_shuffle(self.out(y), PAIR)[..., : size[0], : size[1]].unflatten(0, (-1, frames))
        new = out[:, :, :3]
        if not self.config.gate:
            return new
        gates = ((torch.sigmoid(out[:, :, 3:]) - SHUT) / (OPEN - SHUT)).clamp(0.0, 1.0)
        for number in range(sources.shape[2]):
            still = torch.lerp(still, sources[:, :, number], gates[:, :, 1 + number : 2 + number])
        return torch.lerp(still, new, torch.maximum(gates[:, :, :1], stale))


def _twice(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="nearest")


def _waves(time: Tensor) -> Tensor:
    """Times (B,) as sines and cosines (B, 16)."""
    angles = time[:, None] * torch.tensor([2.0**k for k in range(8)], device=time.device)
    return torch.cat([torch.sin(angles), torch.cos(angles)], 1)
