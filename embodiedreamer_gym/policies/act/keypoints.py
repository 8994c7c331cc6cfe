"""Where things are in a picture, to fractions of a pixel: the mean place of each of a few learnt filters' answers."""

from __future__ import annotations

import torch
from torch import nn

CHANNELS = 32
WIDE = 5  # pixels to a side that the first filters see


class Keypoints(nn.Module):
    """Pictures (B, 3, H, W) to the places (B, 2 K) of K points, x then y, -1 .. 1 from edge to edge.

    A few demonstrations cannot teach a transformer over coarse tokens where a cup stands to a centimetre; a soft arg-max over
    filters at half the picture's size is exact, and moves with the cup.
    Source: Finn et al., Deep Spatial Autoencoders for Visuomotor Learning, 2016, section IV.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.filters = nn.Sequential(
            nn.Conv2d(3, CHANNELS, WIDE, stride=2, padding=WIDE // 2), nn.ReLU(),
            nn.Conv2d(CHANNELS, CHANNELS, 3, padding=1), nn.ReLU(),
            nn.Conv2d(CHANNELS, count, 3, padding=1),
        )  # fmt: skip
        self.sharpness = nn.Parameter(torch.zeros(count))  # logarithm

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Places of the points."""
        answers = self.filters(pictures)
        height, width = answers.shape[2:]
        share = (answers.flatten(2) * self.sharpness.exp()[:, None]).softmax(2).unflatten(2, (height, width))
        across, down = (torch.linspace(-1.0, 1.0, side, device=pictures.device) for side in (width, height))
        x, y = (share.sum(2) * across).sum(2), (share.sum(3) * down).sum(2)
        return torch.cat([x, y], 1)
