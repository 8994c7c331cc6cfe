"""A residual network of basic blocks, of any size, whose weights are named as in torchvision."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

GROUP = 8  # channels normalised together


class FrozenNorm(nn.Module):
    """Batch normalisation whose statistics and scale are loaded and not trained."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.register_buffer("weight", torch.ones(channels))
        self.register_buffer("bias", torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Scale and shift each channel of (B, C, H, W)."""
        state = self.get_buffer
        scale = state("weight") * (state("running_var") + 1e-5).rsqrt()
        shift = state("bias") - state("running_mean") * scale
        return x * scale[:, None, None] + shift[:, None, None]


def _norm(kind: str, channels: int) -> nn.Module:
    return FrozenNorm(channels) if kind == "frozen" else nn.GroupNorm(channels // GROUP, channels)


class Block(nn.Module):
    """Two 3 x 3 convolutions with a residual connection."""

    def __init__(self, before: int, after: int, stride: int, norm: str) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(before, after, 3, stride, 1, bias=False)
        self.bn1 = _norm(norm, after)
        self.conv2 = nn.Conv2d(after, after, 3, 1, 1, bias=False)
        self.bn2 = _norm(norm, after)
        self.downsample = None
        if stride != 1 or before != after:
            self.downsample = nn.Sequential(nn.Conv2d(before, after, 1, stride, bias=False), _norm(norm, after))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features (B, C, H, W) to (B, C', H / stride, W / stride)."""
        around = x if self.downsample is None else self.downsample(x)
        x = torch.relu(self.bn1(self.conv1(x)))
        return torch.relu(self.bn2(self.conv2(x)) + around)


class ResNet(nn.Module):
    """Maps pictures (B, 3, H, W) to features (B, widths[-1], H / s, W / s), s = 2^(stages + 1), rounded up.

    Widths 64, 128, 256, 512 are ResNet18.
    Source: He et al., Deep Residual Learning for Image Recognition, 2015, table 1.
    """

    def __init__(self, widths: Sequence[int], norm: str) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, widths[0], 7, 2, 3, bias=False)
        self.bn1 = _norm(norm, widths[0])
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        self.stages = len(widths)
        for number, (before, after) in enumerate(zip([widths[0], *widths], widths, strict=False)):
            stage = nn.Sequential(Block(before, after, 1 if number == 0 else 2, norm), Block(after, after, 1, norm))
            self.add_module(f"layer{number + 1}", stage)
        for part in self.modules():
            if isinstance(part, nn.Conv2d):
                nn.init.kaiming_normal_(part.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """The last stage's features."""
        x = self.maxpool(torch.relu(self.bn1(self.conv1(x))))
        for number in range(self.stages):
            x = self.get_submodule(f"layer{number + 1}")(x)
        return x
