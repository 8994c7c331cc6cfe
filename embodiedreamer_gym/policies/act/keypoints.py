"""Key points of a picture with subpixel accuracy: the mean position of each of a few learnt colours."""

from __future__ import annotations

import math

import torch
from torch import nn

HIDDEN = 16  # channels of the hidden layer
SHARPNESS = 3.0  # initial softmax scale of scores that are normalised to standard deviation 1 over the picture
LEAST = 1e-3  # added to that deviation, which is 0 for a picture of one colour


class Keypoints(nn.Module):
    """Maps pictures (B, 3, H, W) to the positions (B, 2 K) of K points, x then y, -1 .. 1 from edge to edge.

    With a few demonstrations, a transformer over coarse tokens cannot learn the position of a cup to a centimetre: it
    memorises the pictures. A soft arg-max over scores of single pixels' colours only has to learn which colour matters;
    its result is exact and moves with the cup.
    Source: Finn et al., Deep Spatial Autoencoders for Visuomotor Learning, 2016, section IV, with 1 x 1 filters.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.filters = nn.Sequential(nn.Conv2d(3, HIDDEN, 1), nn.ReLU(), nn.Conv2d(HIDDEN, count, 1, bias=False))
        self.sharpness = nn.Parameter(torch.full((count,), math.log(SHARPNESS)))  # logarithm

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Positions (B, 2 K) of the points."""
        height, width = pictures.shape[2:]
        answers = self._answers(pictures.transpose(0, 1).flatten(1)).unflatten(1, (len(pictures), -1))  # (K, B, H W)
        scale = self.sharpness.exp()[:, None, None] / _deviation(answers.detach())
        down, across = torch.meshgrid(
            torch.linspace(-1.0, 1.0, height), torch.linspace(-1.0, 1.0, width), indexing="ij"
        )
        places = torch.stack([across.flatten(), down.flatten()], 1).to(pictures.device)
        return ((answers * scale).softmax(2) @ places).permute(1, 2, 0).flatten(1)

    def _answers(self, colours: torch.Tensor) -> torch.Tensor:
        """Scores (K, N) of the colours (3, N) of all pixels; convolving each picture takes three times as long."""
        first, bias, last = self.filters.parameters()
        return last.flatten(1) @ torch.addmm(bias[:, None], first.flatten(1), colours).relu()


def _deviation(values: torch.Tensor) -> torch.Tensor:
    """Standard deviation (K, B, 1) of values (K, B, N); `std` takes five times as long."""
    square = torch.linalg.vector_norm(values, dim=2, keepdim=True).square() / values.shape[2]
    return (square - values.mean(2, keepdim=True).square()).clamp(min=0.0).sqrt() + LEAST
