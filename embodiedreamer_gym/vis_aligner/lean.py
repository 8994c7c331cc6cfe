"""The lean model: a small U-Net over pixels in patches, one step, gated, without a VAE."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from embodiedreamer_gym.vis_aligner.channels import Inputs

PATCH = 4
OPEN, SHUT = 0.9, 0.1  # of the sigmoid, where the gate is wholly open or shut: exactly, and with a slope between


@dataclass(frozen=True)
class LeanConfig:
    """Sizes of the lean model.

    widths: channels at 1/4, 1/8 and 1/16 of the picture; detail: channels at the full size; inputs: what it sees; gate:
    False redraws every pixel.
    """

    widths: tuple[int, int, int] = (48, 80, 112)
    detail: int = 12
    inputs: Inputs = field(default_factory=Inputs)
    gate: bool = True


class Block(nn.Module):
    """Two convolutions with a shortcut; the noise level scales and shifts between them; over time where asked."""

    def __init__(self, inside: int, outside: int, level: int, over_time: bool) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(8 if inside % 8 == 0 else 1, inside)
        self.first = nn.Conv2d(inside, outside, 3, padding=1)
        self.level = nn.Linear(level, 2 * outside)
        self.second = nn.Conv2d(outside, outside, 3, padding=1)
        self.skip = nn.Conv2d(inside, outside, 1) if inside != outside else nn.Identity()
        self.time = nn.Conv3d(outside, outside, (3, 1, 1), padding=(1, 0, 0)) if over_time else None

    def forward(self, x: Tensor, level: Tensor, frames: int) -> Tensor:
        """Pictures (B T, C, h, w) of clips of that many frames; level (B, L)."""
        scale, shift = self.level(level).repeat_interleave(frames, 0)[..., None, None].chunk(2, 1)
        y = self.first(F.silu(self.norm(x)))
        y = self.second(F.silu(y * (1 + scale) + shift)) + self.skip(x)
        if self.time is not None:
            clips = y.unflatten(0, (-1, frames)).transpose(1, 2)
            y = y + self.time(F.silu(clips)).transpose(1, 2).flatten(0, 1)
        return y


class Lean(nn.Module):
    """noisy clip, conditions, references -> clip; every input in -1 .. 1."""

    def __init__(self, config: LeanConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LeanConfig()
        a, b, c = config.widths
        area, level = PATCH * PATCH, 64
        self.embed = nn.Sequential(nn.Linear(16, level), nn.SiLU(), nn.Linear(level, level))
        self.frame_in = nn.Conv2d((3 + 3 + config.inputs.per_frame) * area, a, 1)
        self.clip_in = nn.Conv2d(config.inputs.per_clip * area, a, 1)
        self.down1 = Block(a, a, level, False)
        self.down2 = Block(a, b, level, True)
        self.down3 = Block(b, c, level, True)
        self.middle = Block(c, c, level, True)
        self.up2 = Block(c + b, b, level, True)
        self.up1 = Block(b + a, a, level, False)
        self.widen = nn.Conv2d(a, config.detail * area, 1)
        seen = config.detail + config.inputs.per_frame + 3
        self.fine = nn.Conv2d(seen, config.detail, 3, padding=1)
        self.out = nn.Conv2d(config.detail, 4, 3, padding=1)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # pyright: ignore[reportArgumentType]

    def forward(self, noisy: Tensor, time: Tensor, frame: Tensor, clip: Tensor, still: Tensor) -> Tensor:
        """The clean clip (B, T, 3, H, W).

        noisy (B, T, 3, H, W); time (B,); frame (B, T, C, H, W): each frame's condition; clip (B, R, H, W): the
        references; still (B, T, 3, H, W): what the frames would be if nothing new had to be drawn.
        """
        frames, size = noisy.shape[1], noisy.shape[-2:]
        pad = [(-n) % (4 * PATCH) for n in size]
        noisy, frame, clip, still = (F.pad(x, (0, pad[1], 0, pad[0])) for x in (noisy, frame, clip, still))
        level = self.embed(_waves(time))
        local = torch.cat([frame, still], 2).flatten(0, 1)
        x = self.frame_in(F.pixel_unshuffle(torch.cat([noisy.flatten(0, 1), local], 1), PATCH))
        x = x + self.clip_in(F.pixel_unshuffle(clip, PATCH)).repeat_interleave(frames, 0)
        x1 = self.down1(x, level, frames)
        x2 = self.down2(F.avg_pool2d(x1, 2), level, frames)
        x3 = self.middle(self.down3(F.avg_pool2d(x2, 2), level, frames), level, frames)
        y = self.up2(torch.cat([_twice(x3), x2], 1), level, frames)
        y = self.up1(torch.cat([_twice(y), x1], 1), level, frames)
        fine = F.pixel_shuffle(self.widen(F.silu(y)), PATCH)
        out = self.out(F.silu(self.fine(torch.cat([fine, local], 1)))).unflatten(0, (-1, frames))
        new = still + out[:, :, :3]
        if self.config.gate:
            gate = ((torch.sigmoid(out[:, :, 3:]) - SHUT) / (OPEN - SHUT)).clamp(0.0, 1.0)
            new = torch.lerp(still, new, gate)
        return new[..., : size[0], : size[1]]


def _twice(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="nearest")


def _waves(time: Tensor) -> Tensor:
    """Times (B,) as (B, 16) waves."""
    angles = time[:, None] * 2.0 ** torch.arange(8, device=time.device)
    return torch.cat([torch.sin(angles), torch.cos(angles)], 1)
