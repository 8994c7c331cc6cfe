"""From a few numbers straight to a chunk of actions."""

from __future__ import annotations

import torch
from torch import nn

from embodiedreamer_gym.policies.act.config import ActConfig


class Direct(nn.Module):
    """Numbers (B, n) to a chunk of normalised actions (B, k, m): layers with a way around each, no attention.

    Where things are is all that a chunk depends on, and no transformer learns it as fast: there is nothing to attend to.
    """

    def __init__(self, numbers: int, c: ActConfig) -> None:
        super().__init__()
        self.first, self.shape = nn.Linear(numbers, c.width), (c.chunk, c.action_size)
        self.layers = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(c.width), nn.Linear(c.width, c.feedforward), nn.GELU(), nn.Dropout(c.dropout),
                          nn.Linear(c.feedforward, c.width))
            for _ in range(c.encoders)
        )  # fmt: skip
        self.last = nn.Sequential(nn.LayerNorm(c.width), nn.Linear(c.width, c.chunk * c.action_size))

    def forward(self, numbers: torch.Tensor) -> torch.Tensor:
        """The chunk."""
        x = self.first(numbers)
        for layer in self.layers:
            x = x + layer(x)
        return self.last(x).unflatten(1, self.shape)
