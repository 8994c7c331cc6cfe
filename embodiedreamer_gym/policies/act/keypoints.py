"""Where things are in a picture, to fractions of a pixel: the mean place of each of a few learnt colours."""

from __future__ import annotations

import math

import torch
from torch import nn

HIDDEN = 16  # channels between a pixel's colour and its answers
SHARPNESS = 3.0  # at the start; answers have a standard deviation of 1 over the picture


class Keypoints(nn.Module):
    """Pictures (B, 3, H, W) to the places (B, 2 K) of K points, x then y, -1 .. 1 from edge to edge.

    A few demonstrations cannot teach a transformer over coarse tokens where a cup stands to a centimetre: it learns by heart
    what each of them looks like. A soft arg-max over answers to single pixels' colours has nothing else to learn than which
    colour matters; it is exact, and moves with the cup.
    Source: Finn et al., Deep Spatial Autoencoders for Visuomotor Learning, 2016, section IV, with filters of one pixel.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.filters = nn.Sequential(nn.Conv2d(3, HIDDEN, 1), nn.ReLU(), nn.Conv2d(HIDDEN, count, 1))
        self.norm = nn.GroupNorm(count, count)
        self.sharpness = nn.Parameter(torch.full((count,), math.log(SHARPNESS)))  # logarithm

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Places of the points."""
        answers = self.norm(self.filters(pictures))
        height, width = answers.shape[2:]
        share = (answers.flatten(2) * self.sharpness.exp()[:, None]).softmax(2).unflatten(2, (height, width))
        across, down = (torch.linspace(-1.0, 1.0, side, device=pictures.device) for side in (width, height))
        x, y = (share.sum(2) * across).sum(2), (share.sum(3) * down).sum(2)
        return torch.cat([x, y], 1)
