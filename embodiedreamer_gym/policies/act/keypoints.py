"""Where things are in a picture, to fractions of a pixel: the mean place of each of a few learnt colours."""

from __future__ import annotations

import math

import torch
from torch import nn

HIDDEN = 16  # channels between a pixel's colour and its answers
SHARPNESS = 3.0  # at the start, of answers whose standard deviation over the picture is made 1
LEAST = 1e-3  # of that deviation, where a picture has one colour


class Keypoints(nn.Module):
    """Pictures (B, 3, H, W) to the places (B, 2 K) of K points, x then y, -1 .. 1 from edge to edge.

    A few demonstrations cannot teach a transformer over coarse tokens where a cup stands to a centimetre: it memorises
    the pictures. A soft arg-max over answers to single pixels' colours has nothing else to learn than which
    colour matters; it is exact, and moves with the cup.
    Source: Finn et al., Deep Spatial Autoencoders for Visuomotor Learning, 2016, section IV, with filters of one pixel.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.filters = nn.Sequential(nn.Conv2d(3, HIDDEN, 1), nn.ReLU(), nn.Conv2d(HIDDEN, count, 1, bias=False))
        self.sharpness = nn.Parameter(torch.full((count,), math.log(SHARPNESS)))  # logarithm

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Places of the points."""
        height, width = pictures.shape[2:]
        answers = self._answers(pictures.transpose(0, 1).flatten(1)).unflatten(1, (len(pictures), -1))  # (K, B, H W)
        scale = self.sharpness.exp()[:, None, None] / _deviation(answers.detach())
        down, across = torch.meshgrid(
            torch.linspace(-1.0, 1.0, height), torch.linspace(-1.0, 1.0, width), indexing="ij"
        )
        places = torch.stack([across.flatten(), down.flatten()], 1).to(pictures.device)
        return ((answers * scale).softmax(2) @ places).permute(1, 2, 0).flatten(1)

    def _answers(self, colours: torch.Tensor) -> torch.Tensor:
        """Answers (K, N) to colours (3, N) of all pixels at once; convolutions of each picture take three times as long."""
        first, bias, last = self.filters.parameters()
        return last.flatten(1) @ torch.addmm(bias[:, None], first.flatten(1), colours).relu()


def _deviation(values: torch.Tensor) -> torch.Tensor:
    """Standard deviation (K, B, 1) of values (K, B, N); `std` takes five times as long."""
    square = torch.linalg.vector_norm(values, dim=2, keepdim=True).square() / values.shape[2]
    return (square - values.mean(2, keepdim=True).square()).clamp(min=0.0).sqrt() + LEAST
