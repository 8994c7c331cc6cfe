"""A multilayer perceptron from a few numbers to a chunk of actions."""

from __future__ import annotations

import torch
from torch import nn

from embodiedreamer_gym.policies.act.config import ActConfig


class MlpHead(nn.Module):
    """Numbers (B, n) to a chunk of normalised actions (B, k, m): a linear map and residual layers that start at zero.

    A chunk depends on the objects' poses alone, so there is nothing to attend to, and a transformer learns more slowly.
    There is no layer normalisation, because a linear map extrapolates better outside the demonstrations.
    """

    def __init__(self, numbers: int, c: ActConfig) -> None:
        super().__init__()
        self.first, self.last = nn.Linear(numbers, c.width), nn.Linear(c.width, c.chunk * c.action_size)
        self.layers, self.shape = nn.ModuleList(), (c.chunk, c.action_size)
        for _ in range(c.encoders):
            wide, back = nn.Linear(c.width, c.feedforward), nn.Linear(c.feedforward, c.width)
            nn.init.zeros_(back.weight)
            self.layers.append(nn.Sequential(wide, nn.GELU(), nn.Dropout(c.dropout), back))

    def forward(self, numbers: torch.Tensor) -> torch.Tensor:
        """The chunk."""
        x = self.first(numbers)
        for layer in self.layers:
            x = x + layer(x)
        return self.last(x).unflatten(1, self.shape)
